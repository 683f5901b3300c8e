/* Files that are opened at load. */
#ifndef GANTRY_TAU_FILES_H
#define GANTRY_TAU_FILES_H

#include <stddef.h>
#include <sys/types.h>

/* Opens a regular file, without following a link and without waiting for the other end of a pipe. Returns it, or -1 with errno. */
int files_open_regular(const char *path, int flags);

/* Reads the beginning of a file, and puts a zero behind it. Returns the length of the text, or -1 with errno. */
ssize_t files_read_text(int file, char *text, size_t size);

#endif
