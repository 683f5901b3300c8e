/* Files that are opened at load (files.h). */
#include "files.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

int files_open_regular(const char *path, int flags)
{
    struct stat found;
    const int file = open(path, flags | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0644);
    if (file >= 0 && (fstat(file, &found) != 0 || !S_ISREG(found.st_mode))) {
        close(file);
        errno = EINVAL;
        return -1;
    }
    return file;
}

ssize_t files_read_text(int file, char *text, size_t size)
{
    const ssize_t count = read(file, text, size - 1);
    text[count < 0 ? 0 : count] = 0;
    return count;
}
