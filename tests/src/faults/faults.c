/* A library that is loaded before the C library (LD_PRELOAD) and stands between a program and the file system. It works by raw system
 * calls, below the folder FAULTS_ROOT alone, and does what these variables of the environment say:
 *
 * FAULTS_JOURNAL  a file that gets a line per call by which the disk changes: kind, then what it was of, with tabs between; "nothing" for
 *                 a call that changed nothing. All but "write" (an old file was opened for that) and "stale" are counted.
 * FAULTS_KEEP     a folder for hard links to what was replaced or removed, so that it can be put back
 * FAULTS_AT       the number of the call before which the process kills itself, from 1
 * FAULTS_FLOCK    "fail": flock gives ENOLCK; "idle": it does nothing
 * FAULTS_BUSY     nothing may be renamed onto a file that this process has open, or that this names: EBUSY
 * FAULTS_SILLY    an open file that is removed stays as ".nfs…" until it is closed, as on NFS
 * FAULTS_STALE    a file with a path per line: stat does not find them until this process has made an entry in their folder
 * FAULTS_HOST     a folder with what tells machines apart: hostname, machine-id, boot_id, pid-namespace
 *
 * A lock is held around each call and its line, so that the journal is in the order of the calls, whatever thread makes them. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <unistd.h>

typedef char Path[PATH_MAX];

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static const char *root, *keep, *busy, *silly, *stale, *host, *locks;
static long calls, at;
static int journal = -1;
/* Folders in which this process made an entry: what it knows of them is no longer stale. */
static char *touched[4096];
static int touches;

__attribute__((constructor)) static void begin(void) {
    const char *path = getenv("FAULTS_JOURNAL"), *number = getenv("FAULTS_AT");
    root = getenv("FAULTS_ROOT");
    keep = getenv("FAULTS_KEEP");
    busy = getenv("FAULTS_BUSY");
    silly = getenv("FAULTS_SILLY");
    stale = getenv("FAULTS_STALE");
    host = getenv("FAULTS_HOST");
    locks = getenv("FAULTS_FLOCK");
    at = number ? atol(number) : 0;
    if (path) journal = syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
}

/* The path of a name seen from a folder. */
static void absolute(int folder, const char *name, char *out) {
    Path base = "", link;
    if (name[0] != '/') {
        snprintf(link, sizeof link, folder == AT_FDCWD ? "/proc/self/cwd" : "/proc/self/fd/%d", folder);
        long length = syscall(SYS_readlinkat, AT_FDCWD, link, base, sizeof base - 1);
        base[length > 0 ? length : 0] = 0;
    }
    if (snprintf(out, PATH_MAX, "%s%s%s", base, base[0] ? "/" : "", name) >= PATH_MAX) abort();
}

static int inside(const char *path) {
    size_t length = root ? strlen(root) : 0;
    return length && !strncmp(path, root, length) && (path[length] == '/' || !path[length]);
}

static int found(const char *path, struct stat *status) {
    return syscall(SYS_newfstatat, AT_FDCWD, path, status, AT_SYMLINK_NOFOLLOW) == 0;
}

/* Counts a call, and dies before the chosen one. */
static void count(void) {
    if (++calls != at) return;
    syscall(SYS_kill, getpid(), SIGKILL);
    for (;;) pause();
}

__attribute__((format(printf, 1, 2))) static void tell(const char *format, ...) {
    static char line[4 * PATH_MAX];
    va_list words;
    va_start(words, format);
    int length = vsnprintf(line, sizeof line, format, words);
    va_end(words);
    if (journal >= 0 && syscall(SYS_write, journal, line, (size_t)length) != length) abort();
}

static void touch(const char *path) {
    Path folder;
    snprintf(folder, sizeof folder, "%s", path);
    char *end = strrchr(folder, '/');
    if (end) *end = 0;
    for (int i = 0; i < touches; i++)
        if (!strcmp(touched[i], folder)) return;
    if (stale && touches < 4096) touched[touches++] = strdup(folder);
}

/* Keeps what stands at a path. Gives "-" where nothing does, "folder" for a folder, else the number of the link in FAULTS_KEEP. */
static const char *kept(const char *path) {
    static char name[32];
    static long number;
    struct stat status;
    Path to;
    if (!found(path, &status)) return "-";
    if (S_ISDIR(status.st_mode)) return "folder";
    if (!keep) return "lost";
    do {
        snprintf(name, sizeof name, "%ld", ++number);
        snprintf(to, sizeof to, "%s/%s", keep, name);
    } while (syscall(SYS_linkat, AT_FDCWD, path, AT_FDCWD, to, 0) && errno == EEXIST);
    return name;
}

/* How many descriptors of this process are of a file. */
static int holders(const struct stat *of) {
    int held = 0;
    for (int fd = 0; fd < 1024; fd++) {
        struct stat status;
        if (fd != journal && syscall(SYS_fstat, fd, &status) == 0)
            held += status.st_ino == of->st_ino && status.st_dev == of->st_dev;
    }
    return held;
}

/* What the file system of another machine would be told by. */
static const char *of_host(const char *path, char *out) {
    static const char *files[] = {"/proc/sys/kernel/hostname", "/etc/machine-id", "/proc/sys/kernel/random/boot_id"};
    for (int i = 0; host && i < 3; i++)
        if (!strcmp(path, files[i])) {
            snprintf(out, PATH_MAX, "%s%s", host, strrchr(path, '/'));
            return out;
        }
    return path;
}

static int opened(int folder, const char *name, int flags, unsigned mode) {
    Path path, other;
    struct stat status;
    name = of_host(name, other);
    int writes = (flags & O_ACCMODE) != O_RDONLY || flags & O_TRUNC;
    if (!root || !(flags & O_CREAT || writes) || (flags & O_TMPFILE) == O_TMPFILE)
        return syscall(SYS_openat, folder, name, flags, mode);
    absolute(folder, name, path);
    if (!inside(path)) return syscall(SYS_openat, folder, name, flags, mode);
    pthread_mutex_lock(&lock);
    int is_new = flags & O_CREAT && !found(path, &status);
    if (is_new || flags & O_TRUNC) count();
    int fd = syscall(SYS_openat, folder, name, flags, mode), error = errno;
    const char *kind = is_new ? "create" : flags & O_TRUNC ? "empty" : "write";
    if (fd >= 0 && syscall(SYS_fstat, fd, &status) == 0) {
        if (is_new) touch(path);
        tell("%s\t%s\t%lu\n", kind, path, status.st_ino);
    } else
        tell("%s\t%s\n", strcmp(kind, "write") ? "nothing" : "stale", path);
    pthread_mutex_unlock(&lock);
    errno = error;
    return fd;
}

#define OPEN(function, parameters, folder)                                    \
    int function parameters {                                                 \
        va_list rest;                                                         \
        va_start(rest, flags);                                                \
        unsigned mode = flags & (O_CREAT | __O_TMPFILE) ? va_arg(rest, unsigned) : 0; \
        va_end(rest);                                                         \
        return opened(folder, name, flags, mode);                             \
    }
OPEN(open, (const char *name, int flags, ...), AT_FDCWD)
OPEN(open64, (const char *name, int flags, ...), AT_FDCWD)
OPEN(openat, (int folder, const char *name, int flags, ...), folder)
OPEN(openat64, (int folder, const char *name, int flags, ...), folder)

int creat(const char *name, mode_t mode) { return opened(AT_FDCWD, name, O_CREAT | O_WRONLY | O_TRUNC, mode); }
int creat64(const char *name, mode_t mode) { return creat(name, mode); }

int renameat2(int from_folder, const char *from_name, int to_folder, const char *to_name, unsigned flags) {
    Path from, to;
    struct stat old, new, named;
    absolute(from_folder, from_name, from);
    absolute(to_folder, to_name, to);
    if (!inside(to)) return syscall(SYS_renameat2, from_folder, from_name, to_folder, to_name, flags);
    pthread_mutex_lock(&lock);
    count();
    int is_there = found(to, &old), result = -1, error = EBUSY;
    /* (Renaming a file onto itself, under whatever names, changes nothing.) */
    int is_same = is_there && found(from, &new) && old.st_ino == new.st_ino;
    int is_held = is_there && busy && S_ISREG(old.st_mode) &&
                  (holders(&old) || (syscall(SYS_newfstatat, AT_FDCWD, busy, &named, 0) == 0 && named.st_ino == old.st_ino && named.st_dev == old.st_dev));
    if (!is_held) {
        const char *before = is_same || !is_there ? "-" : kept(to);
        result = syscall(SYS_renameat2, from_folder, from_name, to_folder, to_name, flags);
        error = errno;
        if (result == 0 && !is_same) tell("rename\t%s\t%s\t%s\n", from, to, before);
        else tell("nothing\t%s\n", to);
        touch(to);
    } else
        tell("busy\t%s\n", to);
    pthread_mutex_unlock(&lock);
    errno = error;
    return result;
}
int renameat(int from_folder, const char *from, int to_folder, const char *to) {
    return renameat2(from_folder, from, to_folder, to, 0);
}
int rename(const char *from, const char *to) { return renameat2(AT_FDCWD, from, AT_FDCWD, to, 0); }

int linkat(int from_folder, const char *from_name, int to_folder, const char *to_name, int flags) {
    Path from, to;
    absolute(from_folder, from_name, from);
    absolute(to_folder, to_name, to);
    if (!inside(to)) return syscall(SYS_linkat, from_folder, from_name, to_folder, to_name, flags);
    pthread_mutex_lock(&lock);
    count();
    int result = syscall(SYS_linkat, from_folder, from_name, to_folder, to_name, flags), error = errno;
    if (result == 0) tell("link\t%s\t%s\n", to, from), touch(to);
    else tell("nothing\t%s\n", to);
    pthread_mutex_unlock(&lock);
    errno = error;
    return result;
}
int link(const char *from, const char *to) { return linkat(AT_FDCWD, from, AT_FDCWD, to, 0); }

int symlinkat(const char *target, int folder, const char *name) {
    Path path;
    absolute(folder, name, path);
    if (!inside(path)) return syscall(SYS_symlinkat, target, folder, name);
    pthread_mutex_lock(&lock);
    count();
    int result = syscall(SYS_symlinkat, target, folder, name), error = errno;
    if (result == 0) tell("link\t%s\t%s\n", path, target), touch(path);
    else tell("nothing\t%s\n", path);
    pthread_mutex_unlock(&lock);
    errno = error;
    return result;
}
int symlink(const char *target, const char *name) { return symlinkat(target, AT_FDCWD, name); }

int unlinkat(int folder, const char *name, int flags) {
    Path path, aside;
    struct stat status;
    absolute(folder, name, path);
    if (!inside(path)) return syscall(SYS_unlinkat, folder, name, flags);
    pthread_mutex_lock(&lock);
    count();
    int result, error;
    int is_held = silly && !(flags & AT_REMOVEDIR) && found(path, &status) && status.st_nlink == 1 && holders(&status);
    if (is_held) {
        /* (Removed by the next call of close that lets go of it.) */
        snprintf(aside, sizeof aside, "%.*s/.nfs%016lx", (int)(strrchr(path, '/') - path), path, status.st_ino);
        result = syscall(SYS_renameat2, AT_FDCWD, path, AT_FDCWD, aside, 0);
        error = errno;
        tell("silly\t%s\n", path);
    } else {
        const char *before = flags & AT_REMOVEDIR ? "folder" : kept(path);
        result = syscall(SYS_unlinkat, folder, name, flags);
        error = errno;
        if (result == 0) tell("%s\t%s\t%s\n", flags & AT_REMOVEDIR ? "rmdir" : "unlink", path, before), touch(path);
        else tell("nothing\t%s\n", path);
    }
    pthread_mutex_unlock(&lock);
    errno = error;
    return result;
}
int unlink(const char *path) { return unlinkat(AT_FDCWD, path, 0); }
int rmdir(const char *path) { return unlinkat(AT_FDCWD, path, AT_REMOVEDIR); }

int close(int fd) {
    Path link, path;
    if (silly) {
        snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
        long length = syscall(SYS_readlinkat, AT_FDCWD, link, path, sizeof path - 1);
        path[length > 0 ? length : 0] = 0;
        const char *name = strrchr(path, '/');
        struct stat status;
        if (name && !strncmp(name, "/.nfs", 5) && found(path, &status) && holders(&status) == 1)
            syscall(SYS_unlinkat, AT_FDCWD, path, 0);
    }
    return syscall(SYS_close, fd);
}

int mkdirat(int folder, const char *name, mode_t mode) {
    Path path;
    absolute(folder, name, path);
    if (!inside(path)) return syscall(SYS_mkdirat, folder, name, mode);
    pthread_mutex_lock(&lock);
    count();
    int result = syscall(SYS_mkdirat, folder, name, mode), error = errno;
    if (result == 0) tell("mkdir\t%s\n", path), touch(path);
    else tell("nothing\t%s\n", path);
    pthread_mutex_unlock(&lock);
    errno = error;
    return result;
}
int mkdir(const char *path, mode_t mode) { return mkdirat(AT_FDCWD, path, mode); }

/* A call on an open file. */
static int of_file(const char *kind, int fd, long number, long argument) {
    Path link, path;
    struct stat status;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    long length = syscall(SYS_readlinkat, AT_FDCWD, link, path, sizeof path - 1);
    path[length > 0 ? length : 0] = 0;
    if (!inside(path)) return syscall(number, fd, argument);
    pthread_mutex_lock(&lock);
    count();
    int result = syscall(number, fd, argument), error = errno;
    if (result == 0 && syscall(SYS_fstat, fd, &status) == 0)
        tell("%s\t%s\t%lu\t%ld\t%lld\t%s\n", kind, path, status.st_ino, (long)status.st_size,
             status.st_mtim.tv_sec * 1000000000LL + status.st_mtim.tv_nsec, S_ISDIR(status.st_mode) ? "folder" : "file");
    else
        tell("nothing\t%s\n", path);
    pthread_mutex_unlock(&lock);
    errno = error;
    return result;
}
int fsync(int fd) { return of_file("fsync", fd, SYS_fsync, 0); }
int fdatasync(int fd) { return of_file("fsync", fd, SYS_fdatasync, 0); }
int ftruncate(int fd, off_t length) { return of_file("truncate", fd, SYS_ftruncate, length); }
int ftruncate64(int fd, off64_t length) { return of_file("truncate", fd, SYS_ftruncate, length); }

int flock(int fd, int operation) {
    if (!locks) return syscall(SYS_flock, fd, operation);
    errno = ENOLCK;
    return strcmp(locks, "fail") ? 0 : -1;
}

/* Whether what is known of a path is what was so before another machine made it. */
static int is_stale(int folder, const char *name) {
    Path path, line;
    if (!stale || !name || !name[0]) return 0;
    absolute(folder, name, path);
    int is_named = 0;
    FILE *list = fopen(stale, "re");
    while (list && fgets(line, sizeof line, list)) {
        line[strcspn(line, "\n")] = 0;
        is_named |= !strcmp(line, path);
    }
    if (list) fclose(list);
    char *end = strrchr(path, '/');
    if (end) *end = 0;
    for (int i = 0; is_named && i < touches; i++) is_named = strcmp(touched[i], path) != 0;
    if (is_named) {
        pthread_mutex_lock(&lock);
        tell("stale\t%s/%s\n", path, end ? end + 1 : "");
        pthread_mutex_unlock(&lock);
    }
    errno = ENOENT;
    return is_named;
}
int statx(int folder, const char *restrict name, int flags, unsigned mask, struct statx *restrict out) {
    if (is_stale(folder, name)) return -1;
    return syscall(SYS_statx, folder, name, flags, mask, out);
}
int stat64(const char *restrict name, struct stat64 *restrict out) {
    if (is_stale(AT_FDCWD, name)) return -1;
    return syscall(SYS_newfstatat, AT_FDCWD, name, out, 0);
}

ssize_t readlink(const char *restrict name, char *restrict out, size_t size) {
    Path path;
    if (!host || strcmp(name, "/proc/self/ns/pid")) return syscall(SYS_readlinkat, AT_FDCWD, name, out, size);
    snprintf(path, sizeof path, "%s/pid-namespace", host);
    int fd = syscall(SYS_openat, AT_FDCWD, path, O_RDONLY | O_CLOEXEC, 0);
    ssize_t length = fd < 0 ? -1 : read(fd, out, size);
    if (fd >= 0) syscall(SYS_close, fd);
    return length;
}

/* Names of sockets that are no files are a machine's own. */
int bind(int fd, const struct sockaddr *address, socklen_t length) {
    struct sockaddr_un other;
    if (!host || address->sa_family != AF_UNIX || length <= sizeof(sa_family_t) || address->sa_data[0])
        return syscall(SYS_bind, fd, address, length);
    memcpy(&other, address, length);
    size_t used = length - offsetof(struct sockaddr_un, sun_path);
    int more = snprintf(other.sun_path + used, sizeof other.sun_path - used, "%s", strrchr(host, '/'));
    return syscall(SYS_bind, fd, &other, length + more);
}
