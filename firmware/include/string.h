/* What the kernel uses of it; compiler_builtins has the functions. */
#include <stddef.h>
void *memset(void *to, int value, size_t bytes);
void *memcpy(void *to, const void *from, size_t bytes);
