/* What the Rust side of the FreeRTOS back end calls: functions with plain types, so that no
 * structure of the kernel is described twice. Compiled with the kernel, by the image. */
#include "FreeRTOS.h"
#include "task.h"

/* Memory for one task besides its stack. */
uint32_t rp_tcb_bytes(void) { return sizeof(StaticTask_t); }

/* Makes a task in memory of the caller's, which must stay. The slot is what the switch hooks get. */
void *rp_task_create(void (*entry)(void *), const char *name, StackType_t *stack, uint32_t words,
                     void *argument, uint32_t priority, void *tcb, void *slot, uint32_t id)
{
    /* The task must not run before it has its slot. */
    if (xTaskGetSchedulerState() != taskSCHEDULER_NOT_STARTED) vTaskSuspendAll();
    TaskHandle_t task = xTaskCreateStatic(entry, name, words, argument, priority, stack,
                                          (StaticTask_t *)tcb);
    if (task != NULL) {
        vTaskSetThreadLocalStoragePointer(task, 0, slot);
        vTaskSetThreadLocalStoragePointer(task, 1, (void *)(uintptr_t)id);
        vTaskSetThreadLocalStoragePointer(task, 2, stack);
        vTaskSetThreadLocalStoragePointer(task, 3, (void *)(uintptr_t)(words * sizeof(StackType_t)));
    }
    if (xTaskGetSchedulerState() != taskSCHEDULER_NOT_STARTED) (void)xTaskResumeAll();
    return task;
}

void rp_start(void) { vTaskStartScheduler(); }

/* The Rust side masks by itself, to this level. */
_Static_assert(configMAX_SYSCALL_INTERRUPT_PRIORITY == 0x50, "replenish-os masks to 0x50");

/* Which priorities may have tasks in their lists: see FreeRTOSConfig.h. */
uint32_t rp_ready[(configMAX_PRIORITIES + 31) / 32];

/* Stops the calling task for good. */
void rp_halt(void) { for (;;) vTaskSuspend(NULL); }

uint32_t rp_stack_unused(void *task) { return uxTaskGetStackHighWaterMark((TaskHandle_t)task) * sizeof(StackType_t); }

uint32_t rp_priority(void *task) { return (uint32_t)uxTaskPriorityGet((TaskHandle_t)task); }
const char *rp_name(void *task) { return pcTaskGetName((TaskHandle_t)task); }

/* Replaces the port's: no tick interrupt. Every wait with an end is a deadline of ours. */
void vPortSetupTimerInterrupt(void) {}

/* How often the idle task has waited for an interrupt. */
volatile uint32_t rp_idle_waits;
void vApplicationIdleHook(void)
{
    rp_idle_waits = rp_idle_waits + 1;
    __asm volatile("dsb\n wfi\n isb" ::: "memory");
}

/* The running task, from the kernel's data alone: nothing of ours that an overflow may have hit.
 * Returns its number (0: none, or the idle task). */
uint32_t rp_running(const char **name, const uint8_t **stack, uint32_t *bytes)
{
    if (xTaskGetSchedulerState() == taskSCHEDULER_NOT_STARTED) return 0;
    *name = pcTaskGetName(NULL);
    *stack = (const uint8_t *)pvTaskGetThreadLocalStoragePointer(NULL, 2);
    *bytes = (uint32_t)(uintptr_t)pvTaskGetThreadLocalStoragePointer(NULL, 3);
    return (uint32_t)(uintptr_t)pvTaskGetThreadLocalStoragePointer(NULL, 1);
}

extern void rp_stack_overflow(void);
void vApplicationStackOverflowHook(TaskHandle_t task, char *name)
{
    (void)task;
    (void)name;
    rp_stack_overflow();
}

void vApplicationGetIdleTaskMemory(StaticTask_t **tcb, StackType_t **stack, configSTACK_DEPTH_TYPE *words)
{
    static StaticTask_t idle;
    static StackType_t idle_stack[configMINIMAL_STACK_SIZE];
    *tcb = &idle;
    *stack = idle_stack;
    *words = configMINIMAL_STACK_SIZE;
}

void *rp_current_task(void) { return xTaskGetCurrentTaskHandle(); }
