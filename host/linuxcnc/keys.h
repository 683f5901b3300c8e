/* Key of the component: who has it may be the client. As host/server/src/key_file.rs. */
#ifndef GANTRY_TAU_KEYS_H
#define GANTRY_TAU_KEYS_H

#include <stddef.h>

#include "gantry_tau.h"

/*
 * Reads a key file of `gantry-tau key new`, and draws the secret of the cookies. A file that others may read is refused. Called at load only.
 * Returns 0, or -1 with one sentence in `error`.
 */
int keys_read(const char *path, gt_keys *keys, char *error, size_t size);

#endif
