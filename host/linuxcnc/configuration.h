/* Configuration of the server: the profile of the thesis, with axes and motors of `machine.h`. */
#ifndef GANTRY_TAU_CONFIGURATION_H
#define GANTRY_TAU_CONFIGURATION_H

#include <stddef.h>

#include "gantry_tau.h"

/* Fills it in, but for the cycle. Returns 0, or -1 with one sentence in `text`. */
int configure(gt_server_config *config, int lockstep, char *text, size_t size);

#endif
