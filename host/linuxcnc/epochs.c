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
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "files.h"

/* Epochs reserved by one write of the file: 2^32 sessions per run, for 2^32 runs. */
#define RESERVE (UINT64_C(1) << 32)

/* The locked file; ABSENT without one. */
#define ABSENT (-1)
static int lock = ABSENT;

/* Writes the path of a file beside another. Returns 0, or -1 with errno. */
static int beside(const char *path, const char *extension, char text[PATH_MAX])
{
    if (snprintf(text, PATH_MAX, "%s.%s", path, extension) >= PATH_MAX) {
        errno = ENAMETOOLONG;
        return -1;
    }
    return 0;
}

/* Locks the counter until the component is unloaded or its process ends. Returns 0, or -1 with errno: EWOULDBLOCK if another server has it. */
static int take_lock(const char *path)
{
    static char name[PATH_MAX]; /* not on the stack */
    struct stat found;
    char owner[32];
    ssize_t length;
    if (lstat(path, &found) == 0 && !S_ISREG(found.st_mode)) {
        errno = EINVAL;
        return -1;
    }
    if (beside(path, "lock", name) != 0) {
        return -1;
    }
    lock = files_open_regular(name, O_RDWR | O_CREAT);
    if (lock < 0) {
        return -1;
    }
    if (flock(lock, LOCK_EX | LOCK_NB) != 0) {
        const int reason = errno;
        close(lock);
        lock = ABSENT;
        errno = reason;
        return -1;
    }
    length = files_read_text(lock, owner, sizeof owner);
    if (length < 0) {
        return -1;
    }
    if (length > 0 && strncmp(owner, "pid ", 4) != 0) {
        errno = EEXIST; /* another file has the lock's name */
        return -1;
    }
    return ftruncate(lock, 0) != 0 || lseek(lock, 0, SEEK_SET) != 0 || dprintf(lock, "pid %ld (gantry_tau of LinuxCNC)\n", (long)getpid()) < 0 ? -1 : 0;
}

void epochs_release(void)
{
    if (lock != ABSENT) {
        /* Nothing is written: a disk that hangs must not hold up the end. A child that was forked meanwhile has the file too. */
        flock(lock, LOCK_UN);
        close(lock);
        lock = ABSENT;
    }
}

/* Reads the beginning of a file, 31 bytes at most. Returns the length, or -1 with errno. */
static ssize_t read_file(const char *path, char text[32])
{
    ssize_t count;
    const int file = files_open_regular(path, O_RDONLY);
    if (file < 0) {
        return -1;
    }
    count = files_read_text(file, text, 32);
    close(file);
    return count;
}

/* Reads the counter. Returns 0; 1 if the file is not a number, -1 with errno. */
static int read_counter(const char *path, uint64_t *used)
{
    char text[32];
    char *end;
    const ssize_t count = read_file(path, text);
    *used = 0;
    if (count < 0) {
        return errno == ENOENT ? 0 : -1;
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

/* Removes the second file of a crash. Returns 0, or -1 with errno: EEXIST if another file has its name, such as another machine's counter. */
static int remove_second(const char *second)
{
    static char name[PATH_MAX]; /* not on the stack */
    struct stat found;
    char text[32];
    const ssize_t count = read_file(second, text);
    if (count < 0) {
        return errno == ENOENT ? 0 : -1;
    }
    if (beside(second, "lock", name) != 0) {
        return -1;
    }
    if (count == sizeof text - 1 || strspn(text, "0123456789\n") != (size_t)count || lstat(name, &found) == 0) {
        errno = EEXIST;
        return -1;
    }
    return unlink(second);
}

/* Writes a second file, flushes it, renames it, flushes the folder: a crash leaves the old or the new number. Returns 0, or -1 with errno. */
static int persist(const char *path, uint64_t value)
{
    static char second[PATH_MAX], folder[PATH_MAX]; /* not on the stack */
    char text[32];
    const int length = snprintf(text, sizeof text, "%" PRIu64 "\n", value);
    int file;
    if (beside(path, "new", second) != 0 || remove_second(second) != 0) {
        return -1;
    }
    file = open(second, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
    if (file < 0) {
        return -1;
    }
    if (write(file, text, (size_t)length) != length) {
        close(file);
        return -1;
    }
    if (flush_and_close(file) != 0 || rename(second, path) != 0) {
        return -1;
    }
    snprintf(folder, sizeof folder, "%s", path);
    file = open(dirname(folder), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    return file < 0 ? -1 : flush_and_close(file);
}

int epochs_reserve(const char *path, uint64_t *first, uint64_t *last, char *error, size_t size)
{
    uint64_t used;
    int outcome;
    if (take_lock(path) != 0) {
        const char *reason = errno == EWOULDBLOCK ? "in use by another server"
                             : errno == EEXIST    ? "a file of this name with .lock behind it is another program's; move it away"
                                                  : strerror(errno);
        snprintf(error, size, "epoch_file=%s: %s", path, reason);
        epochs_release();
        return -1;
    }
    outcome = read_counter(path, &used);
    if (outcome > 0) {
        snprintf(error, size, "epoch_file=%s does not contain a counter", path);
    } else if (outcome == 0 && used > UINT64_MAX - RESERVE) {
        snprintf(error, size, "epoch_file=%s: the counter is used up", path);
    } else if (outcome < 0 || persist(path, used + RESERVE) != 0) {
        const char *reason = errno == EEXIST ? "a file of this name with .new behind it is another program's; move it away" : strerror(errno);
        snprintf(error, size, "epoch_file=%s: %s", path, reason);
    } else {
        *first = used + 1;
        *last = used + RESERVE;
        return 0;
    }
    epochs_release();
    return -1;
}
