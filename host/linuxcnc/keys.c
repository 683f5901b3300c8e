/* Key of the component (keys.h). */
#include "keys.h"

#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include "files.h"

/* Longest text that is read, and a zero; a key has 100 bytes. */
enum { TEXT = 257 };

/* Reads the text of a file that only its owner may read. Returns its length, or -1 with one sentence in `error`. */
static ssize_t read_private(const char *path, char *text, size_t capacity, char *error, size_t size)
{
    struct stat found;
    ssize_t length = -1;
    const int file = files_open_regular(path, O_RDONLY);
    if (file < 0) {
        snprintf(error, size, "key=%s: %s", path, errno == EINVAL ? "is not a regular file" : strerror(errno));
        return -1;
    }
    if (fstat(file, &found) != 0 || (found.st_mode & 077) != 0) {
        snprintf(error, size, "key=%s: others may read or write it; run: chmod 600 %s", path, path);
    } else if (found.st_uid != geteuid() && found.st_uid != 0) {
        snprintf(error, size, "key=%s: belongs to another user", path);
    } else {
        length = files_read_text(file, text, capacity);
        if (length < 0) {
            snprintf(error, size, "key=%s: %s", path, strerror(errno));
        }
    }
    close(file);
    return length;
}

int keys_read(const char *path, gt_keys *keys, char *error, size_t size)
{
    char text[TEXT];
    gt_error wrong;
    const ssize_t length = read_private(path, text, sizeof text, error, size);
    if (length < 0) {
        return -1;
    }
    memset(keys, 0, sizeof *keys);
    keys->count = 1;
    if (gt_key_parse((const uint8_t *)text, (size_t)length, &keys->keys[0], &wrong) != GT_CODE_OK) {
        snprintf(error, size, "key=%s: line %.0f is not that of a key file; make one with gantry-tau key new", path, wrong.value);
        return -1;
    }
    if (getrandom(keys->start_secret, sizeof keys->start_secret, 0) != (ssize_t)sizeof keys->start_secret) {
        snprintf(error, size, "the system gives no random numbers: %s", strerror(errno));
        return -1;
    }
    return 0;
}
