/* Epochs from a counter that is persisted before use (epochs.h). */
#include "epochs.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <libgen.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Epochs reserved by one write of the file: 2^32 sessions per run, for 2^32 runs. */
#define RESERVE (UINT64_C(1) << 32)

/* Reads the counter. Returns 0; 1 if the file is not a number, -1 with errno. */
static int read_counter(const char *path, uint64_t *used)
{
    char text[32] = "";
    char *end;
    ssize_t count;
    const int file = open(path, O_RDONLY | O_CLOEXEC);
    *used = 0;
    if (file < 0) {
        return errno == ENOENT ? 0 : -1;
    }
    count = read(file, text, sizeof text - 1);
    close(file);
    if (count < 0) {
        return -1;
    }
    errno = 0;
    *used = strtoull(text, &end, 10);
    return text[0] < '0' || text[0] > '9' || errno != 0 || end[strspn(end, " \r\n")] != 0 ? 1 : 0;
}

static int flush_and_close(int file)
{
    const int failed = fsync(file);
    return close(file) != 0 || failed != 0 ? -1 : 0;
}

/* Writes a second file, flushes it, renames it, flushes the folder: a crash leaves the old or the new number. Returns 0, or -1 with errno. */
static int persist(const char *path, uint64_t value)
{
    static char beside[PATH_MAX], folder[PATH_MAX]; /* not on the stack */
    char text[32];
    const int length = snprintf(text, sizeof text, "%" PRIu64 "\n", value);
    int file;
    if (snprintf(beside, sizeof beside, "%s.%ld", path, (long)getpid()) >= (int)sizeof beside) {
        errno = ENAMETOOLONG;
        return -1;
    }
    file = open(beside, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (file < 0) {
        return -1;
    }
    if (write(file, text, (size_t)length) != length) {
        close(file);
        return -1;
    }
    if (flush_and_close(file) != 0 || rename(beside, path) != 0) {
        return -1;
    }
    snprintf(folder, sizeof folder, "%s", path);
    file = open(dirname(folder), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    return file < 0 ? -1 : flush_and_close(file);
}

int epochs_reserve(const char *path, uint64_t *first, uint64_t *last, char *error, size_t size)
{
    uint64_t used;
    const int outcome = read_counter(path, &used);
    if (outcome > 0) {
        snprintf(error, size, "epoch_file=%s does not contain a counter", path);
        return -1;
    }
    if (outcome == 0 && used > UINT64_MAX - RESERVE) {
        snprintf(error, size, "epoch_file=%s: the counter is used up", path);
        return -1;
    }
    if (outcome < 0 || persist(path, used + RESERVE) != 0) {
        snprintf(error, size, "epoch_file=%s: %s", path, strerror(errno));
        return -1;
    }
    *first = used + 1;
    *last = used + RESERVE;
    return 0;
}
