/* See executor.h. */
#include "executor.h"
