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
        portNVIC_INT_CTRL_REG = portNVIC_PENDSVSET_BIT;
    } else {
        tcb->ulNotifiedValue[0] = 0;
    }
    vPortSetBASEPRI(before); /* the switch happens here */
    __asm volatile("dsb\n isb" ::: "memory");
}

/* From a task, masked or not, or from an interrupt that may call the kernel. */
void rp_wake(void *task)
{
    TCB_t *const tcb = (TCB_t *)task;
    const uint32_t before = ulPortRaiseBASEPRI();
    if (tcb->ucNotifyState[0] == taskWAITING_NOTIFICATION) {
        tcb->ucNotifyState[0] = taskNOT_WAITING_NOTIFICATION;
        if (uxSchedulerSuspended == 0) {
            listREMOVE_ITEM(&(tcb->xStateListItem));
            prvAddTaskToReadyList(tcb);
            if (tcb->uxPriority > pxCurrentTCB->uxPriority) portYIELD_WITHIN_API();
        } else {
            listINSERT_END(&xPendingReadyList, &(tcb->xEventListItem));
        }
    } else {
        tcb->ulNotifiedValue[0] = 1;
    }
    vPortSetBASEPRI(before);
}

/* The highest list that has tasks, below uxTopReadyPriority's, which has none any more. A bit is cleared
 * when its list is found empty. */
static void rp_find_next(void)
{
    UBaseType_t at = uxTopReadyPriority;
    uint32_t word = at / 32;
    uint32_t bits = rp_ready[word];
    do {
        bits &= ~(1UL << (at % 32));
        rp_ready[word] = bits;
        while (bits == 0) bits = rp_ready[--word]; /* the idle task is always ready */
        at = word * 32 + 31 - (uint32_t)__builtin_clz(bits);
    } while (listLIST_IS_EMPTY(&(pxReadyTasksLists[at])));
    uxTopReadyPriority = at;
}

/* Switches to the first task of the highest list that has one; the port calls it, masked.
 *
 * A task that is still in its ready list was preempted (or yielded); one that is not, has blocked. The one
 * reading of the clock in rp_switched ends the time of the one task and begins that of the other. Lists are
 * plain queues here: what runs is the head and stays there when it is preempted, as SCHED_FIFO wants it,
 * and what is put at the end goes behind all others, for the cursor never moves. (The kernel's own switch
 * moves it, and so rotates equals.) */
#undef vTaskSwitchContext
void vTaskSwitchContext(void)
{
    if (uxSchedulerSuspended != 0) {
        xYieldPendings[0] = pdTRUE;
        return;
    }
    xYieldPendings[0] = pdFALSE;
    TCB_t *const out = pxCurrentTCB;
    const uint32_t *const end = (const uint32_t *)out->pxStack;
    const uint32_t fill = 0x01010101UL * tskSTACK_FILL_BYTE;
    if (out->pxTopOfStack <= out->pxStack || end[0] != fill || end[1] != fill || end[2] != fill || end[3] != fill)
        vApplicationStackOverflowHook((TaskHandle_t)out, out->pcTaskName);
    const uint32_t preempted = listLIST_ITEM_CONTAINER(&(out->xStateListItem)) ==
                               &(pxReadyTasksLists[out->uxPriority]);
    if (listLIST_IS_EMPTY(&(pxReadyTasksLists[uxTopReadyPriority]))) rp_find_next();
    TCB_t *const in = listGET_OWNER_OF_HEAD_ENTRY(&(pxReadyTasksLists[uxTopReadyPriority]));
    pxCurrentTCB = in;
    rp_switched(in->pvThreadLocalStoragePointers[0], preempted);
}
