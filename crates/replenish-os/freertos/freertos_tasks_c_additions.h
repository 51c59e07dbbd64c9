/* The kernel includes this at the end of tasks.c, where its lists can be reached. */

/* Gives a task another priority, at the head or at the tail of its list, and pends a switch if that
 * may change who runs. The caller has masked the kernel's interrupts; unlike vTaskPrioritySet this
 * does not unmask them. */
void rp_place(void *task, uint32_t priority, uint32_t head)
{
    TCB_t *const tcb = (TCB_t *)task;
    ListItem_t *const item = &(tcb->xStateListItem);
    const BaseType_t ready = listIS_CONTAINED_WITHIN(&(pxReadyTasksLists[tcb->uxPriority]), item);
    tcb->uxPriority = priority;
    if (!ready) return; /* it waits, and is put into its list when it is woken */
    (void)uxListRemove(item);
    if (head) {
        List_t *const list = &(pxReadyTasksLists[priority]);
        list->pxIndex = (ListItem_t *)&(list->xListEnd);
        /* Before what follows the end marker: what was first is second. */
        item->pxNext = list->xListEnd.pxNext;
        item->pxPrevious = (ListItem_t *)&(list->xListEnd);
        list->xListEnd.pxNext->pxPrevious = item;
        list->xListEnd.pxNext = item;
        item->pxContainer = list;
        list->uxNumberOfItems++;
        taskRECORD_READY_PRIORITY(priority);
    } else {
        prvAddTaskToReadyList(tcb);
    }
    if (xSchedulerRunning && (tcb == pxCurrentTCB || priority > pxCurrentTCB->uxPriority))
        portYIELD_WITHIN_API();
}
