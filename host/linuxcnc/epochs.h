/* Epochs from a counter that is persisted before use, so that frames of earlier sessions stay invalid. As host/server/src/state/. */
#ifndef GANTRY_TAU_EPOCHS_H
#define GANTRY_TAU_EPOCHS_H

#include <stddef.h>
#include <stdint.h>

/*
 * Reserves epochs that no other run of a server uses: locks the counter, reads it, writes it back with the reserve added, flushes it to the
 * disk. A missing file counts as zero. Called at load only: the thread never touches the disk.
 * Returns 0, or -1 with one sentence in `error`; a file that is not a number is not overwritten.
 */
int epochs_reserve(const char *path, uint64_t *first, uint64_t *last, char *error, size_t size);

/* Releases the counter for the next server. Does nothing if it is not locked. */
void epochs_release(void);

#endif
