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
        rp_note_ready(priority);
        taskRECORD_READY_PRIORITY(priority);
    } else {
        prvAddTaskToReadyList(tcb);
    }
    if (xSchedulerRunning && (tcb == pxCurrentTCB || priority > pxCurrentTCB->uxPriority))
        portYIELD_WITHIN_API();
}

/* Waiting and waking: what ulTaskNotifyTake and vTaskNotifyGive do for a wait without end and a
 * number that only counts as "some", on the same fields of the task, in a third of the instructions:
 * there is no tick that could interfere with the lists, so that masking for their length does. */

/* Waits until rp_wake(); one that came before ends the wait at once. Not while masked. */
void rp_block(void)
{
    TCB_t *const tcb = pxCurrentTCB;
    const uint32_t before = ulPortRaiseBASEPRI();
    if (tcb->ulNotifiedValue[0] == 0) {
        tcb->ucNotifyState[0] = taskWAITING_NOTIFICATION;
        listREMOVE_ITEM(&(tcb->xStateListItem));
        listINSERT_END(&xSuspendedTaskList, &(tcb->xStateListItem));
        portYIELD_WITHIN_API();
        vPortSetBASEPRI(before); /* the switch happens here */
        __asm volatile("isb" ::: "memory");
        (void)ulPortRaiseBASEPRI();
    }
    tcb->ulNotifiedValue[0] = 0;
    tcb->ucNotifyState[0] = taskNOT_WAITING_NOTIFICATION;
    vPortSetBASEPRI(before);
}

/* From a task, masked or not, or from an interrupt that may call the kernel. */
void rp_wake(void *task)
{
    TCB_t *const tcb = (TCB_t *)task;
    const uint32_t before = ulPortRaiseBASEPRI();
    const uint8_t state = tcb->ucNotifyState[0];
    tcb->ulNotifiedValue[0] = 1;
    tcb->ucNotifyState[0] = taskNOTIFICATION_RECEIVED;
    if (state == taskWAITING_NOTIFICATION) {
        if (uxSchedulerSuspended == 0) {
            listREMOVE_ITEM(&(tcb->xStateListItem));
            prvAddTaskToReadyList(tcb);
            if (tcb->uxPriority > pxCurrentTCB->uxPriority) portYIELD_WITHIN_API();
        } else {
            listINSERT_END(&xPendingReadyList, &(tcb->xEventListItem));
        }
    }
    vPortSetBASEPRI(before);
}
