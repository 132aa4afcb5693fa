/* A host in C++ whose logger throws an exception, or jumps out by longjmp, or calls the instance again.

   The test hands it an instance and a call that makes it log; each function tells what came back. */
#include <csetjmp>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <stdexcept>
#include <string>

namespace {
struct Host {
    int what;
    void *instance;
    int (*get)(void *instance);
    int messages;
    int answer;
    char text[1000];
    jmp_buf back;
};

enum { NOTHING, THROW, JUMP, GET };

/* Messages are expanded as by printf, as hosts do. */
void expand(Host *host, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(host->text, sizeof host->text, format, arguments);
    va_end(arguments);
}
}  // namespace

extern "C" {
void logger(void *environment, const char *name, int, const char *, const char *format, ...) {
    Host *host = static_cast<Host *>(environment);
    host->messages++;
    expand(host, format);
    if (host->what == THROW) throw std::runtime_error(std::string(name) + ": " + host->text);
    if (host->what == JUMP) longjmp(host->back, 1);
    if (host->what == GET && host->messages == 1) host->answer = host->get(host->instance);
}

/* 1 where an exception with the message came back, 2 after a jump, else 0; the call's answer in `status`. */
int call_as_host(Host *host, int (*call)(void *), void *instance, int *status) {
    if (setjmp(host->back)) return 2;
    try {
        *status = call(instance);
        return 0;
    } catch (const std::runtime_error &error) {
        return strstr(error.what(), host->text) ? 1 : 3;
    }
}

Host *new_host(void) { return new Host(); }
void free_host(Host *host) { delete host; }
void tell_host(Host *host, int what, void *instance, int (*get)(void *)) {
    host->what = what, host->instance = instance, host->get = get, host->messages = 0, host->answer = -1;
}
int messages(const Host *host) { return host->messages; }
int answer(const Host *host) { return host->answer; }
const char *text(const Host *host) { return host->text; }
}
