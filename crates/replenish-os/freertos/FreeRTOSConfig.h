/* The kernel as replenish needs it: no tick, no heap of its own, strict FIFO, and hooks that see
 * every switch. An image may define the values in #ifndef itself. */
#ifndef FREERTOS_CONFIG_H
#define FREERTOS_CONFIG_H

#include <stddef.h>
#include <stdint.h>

#ifndef configCPU_CLOCK_HZ
#define configCPU_CLOCK_HZ 168000000UL
#endif

/* Priorities 0 (idle, and workers suspended for want of budget) to 99, as on Linux. */
#define configMAX_PRIORITIES 100
#define configUSE_PORT_OPTIMISED_TASK_SELECTION 0
#define configUSE_PREEMPTION 1
#define configUSE_TIME_SLICING 0
#define configIDLE_SHOULD_YIELD 0

/* There is no tick interrupt (see vPortSetupTimerInterrupt in shim.c); the kernel wants a number. */
#define configTICK_RATE_HZ 1000
#define configTICK_TYPE_WIDTH_IN_BITS TICK_TYPE_WIDTH_32_BITS
#define configUSE_IDLE_HOOK 1
#define configUSE_TICK_HOOK 0

/* Memory comes from the image: tasks are made with memory of ours, before the heap is sealed. */
#define configSUPPORT_STATIC_ALLOCATION 1
#define configSUPPORT_DYNAMIC_ALLOCATION 0
#ifndef configMINIMAL_STACK_SIZE
#define configMINIMAL_STACK_SIZE 96
#endif
#define configMAX_TASK_NAME_LEN 16
#define configCHECK_FOR_STACK_OVERFLOW 2

#define configUSE_MUTEXES 0 /* inheritance is ours: src/rtos/inherit.rs */
#define configINCLUDE_FREERTOS_TASK_C_ADDITIONS_H 1
#define configUSE_TASK_NOTIFICATIONS 1
#define configTASK_NOTIFICATION_ARRAY_ENTRIES 1
/* Of each task: its slot, number, stack and the stack's size: here, beside the kernel's own data of
 * the task, they outlive the overflow of its stack. */
#define configNUM_THREAD_LOCAL_STORAGE_POINTERS 4
#define configUSE_CO_ROUTINES 0
#define configUSE_TIMERS 0
#define configQUEUE_REGISTRY_SIZE 0

#define INCLUDE_vTaskPrioritySet 0
#define INCLUDE_uxTaskPriorityGet 1
#define INCLUDE_vTaskSuspend 1
#define INCLUDE_vTaskDelete 0
#define INCLUDE_vTaskDelay 0
#define INCLUDE_xTaskDelayUntil 0
#define INCLUDE_xTaskGetSchedulerState 1
#define INCLUDE_uxTaskGetStackHighWaterMark 1
#define INCLUDE_xTaskGetCurrentTaskHandle 1

/* Cortex-M interrupt priorities, 4 bits. Interrupts of 5..15 may call the kernel. */
#define configPRIO_BITS 4
#define configKERNEL_INTERRUPT_PRIORITY (15 << (8 - configPRIO_BITS))
#define configMAX_SYSCALL_INTERRUPT_PRIORITY (5 << (8 - configPRIO_BITS))
#define configCHECK_HANDLER_INSTALLATION 0
#define vPortSVCHandler SVCall
#define xPortPendSVHandler PendSV
#define xPortSysTickHandler SysTick

extern void rp_assert_failed(const char *file, uint32_t line);
#define configASSERT(x) \
    if ((x) == 0) rp_assert_failed(__FILE__, __LINE__)

/* The kernel looks for the highest task list by list, from the highest that was ready downward: 400
 * instructions from 95 to 10. So a bit is set for each list that a task is put into, and a switch looks for
 * the next list by these bits where the highest has no task any more. */
extern uint32_t rp_ready[];
#define rp_note_ready(priority) (rp_ready[(priority) / 32] |= 1UL << ((priority) % 32))
#define traceMOVED_TASK_TO_READY_STATE(tcb) rp_note_ready((tcb)->uxPriority)

/* The switch itself is ours, at the end of freertos_tasks_c_additions.h: what the port calls by this name
 * in assembler. The kernel's stays unused. */
#define vTaskSwitchContext rp_kernel_switch

/* `slot`'s task runs from now on; the one that ran was preempted, or has blocked. */
extern void rp_switched(void *slot, uint32_t preempted);
/* The first task, which the kernel starts without a switch. */
#define traceTASK_SWITCHED_IN() rp_switched(pxCurrentTCB->pvThreadLocalStoragePointers[0], 1)

#endif
