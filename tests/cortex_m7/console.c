/* What newlib's printf asks of a board: its text goes to the debugger or the emulator. */

#include <errno.h>
#include <string.h>
#include <sys/stat.h>

#include "semihosting.h"

int _write(int file, const char *text, int length);
int _close(int file);
int _fstat(int file, struct stat *status);
int _isatty(int file);
int _lseek(int file, int offset, int from);
int _read(int file, char *text, int length);
void *_sbrk(int more);
void _exit(int status) __attribute__((noreturn));
int _kill(int process, int signal);
int _getpid(void);

int _write(int file, const char *text, int length)
{
    (void)file;
    for (int k = 0; k < length; k++) {
        const char character[2] = {text[k], '\0'};
        tell_text(character);
    }
    return length;
}

int _close(int file)
{
    (void)file;
    return -1;
}

int _fstat(int file, struct stat *status)
{
    (void)file;
    memset(status, 0, sizeof *status);
    status->st_mode = S_IFCHR;
    return 0;
}

int _isatty(int file)
{
    (void)file;
    return 1;
}

int _lseek(int file, int offset, int from)
{
    (void)file;
    (void)offset;
    (void)from;
    return 0;
}

int _read(int file, char *text, int length)
{
    (void)file;
    (void)text;
    (void)length;
    return 0;
}

/* printf may end in abort. */
void _exit(int status)
{
    leave((uint32_t)status);
    for (;;) {
    }
}

int _kill(int process, int signal)
{
    (void)process;
    (void)signal;
    return -1;
}

int _getpid(void)
{
    return 1;
}

/* printf buffers a line, and converts numbers there. */
void *_sbrk(int more)
{
    static char heap[16384];
    static int used;
    if (used + more > (int)sizeof heap) {
        errno = ENOMEM;
        return (void *)-1;
    }
    used += more;
    return heap + used - more;
}
