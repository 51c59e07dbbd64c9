/* The kernel includes this and uses nothing of it; so that no C library is needed. */
