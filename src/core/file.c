/* SPDX-License-Identifier: Apache-2.0 */
/*
 * file.c: files that are complete or not there.
 *
 * A result is written to a temporary beside its final name, synced and renamed,
 * so a crash, a full disk or Ctrl-C leaves the old file untouched. Pipes and
 * devices cannot be renamed onto: for them the result is gathered in memory and
 * sent on commit, which also lets formats that seek (TIFF) go into a pipe.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "core/core.h"

/* ---- temporaries that a signal handler can remove ---- */

enum { SLOT_FREE, SLOT_TAKEN, SLOT_ARMED };

/* Slots are reused and never freed: a signal handler may walk the list at any moment. */
typedef struct temporary_slot {
    struct temporary_slot *next;
    atomic_int state;
    char path[PATH_MAX];
} temporary_slot;

static _Atomic(temporary_slot *) temporaries;

static temporary_slot *slot_take(void) {
    for (temporary_slot *s = atomic_load(&temporaries); s != NULL; s = s->next) {
        int expected = SLOT_FREE;
        if (atomic_compare_exchange_strong(&s->state, &expected, SLOT_TAKEN)) {
            return s;
        }
    }
    temporary_slot *s = core_calloc(1, sizeof *s);
    if (s != NULL) {
        atomic_store(&s->state, SLOT_TAKEN);
        s->next = atomic_load(&temporaries);
        while (!atomic_compare_exchange_weak(&temporaries, &s->next, s)) {
        }
    }
    return s;
}

static void slot_release(temporary_slot *slot) {
    if (slot != NULL) {
        atomic_store(&slot->state, SLOT_FREE);
    }
}

void core_files_abort_all(void) {
    int saved = errno;
    for (temporary_slot *s = atomic_load(&temporaries); s != NULL; s = s->next) {
        if (atomic_load(&s->state) == SLOT_ARMED) {
            unlink(s->path);
        }
    }
    errno = saved;
}

/* ---- writing ---- */

struct core_file {
    FILE *stream;
    char *path;           /* as the user gave it, for messages */
    char *target;         /* what is renamed onto: absolute, links followed; NULL for special files */
    char *name;           /* core_file_temporary */
    temporary_slot *slot; /* NULL for special files */
    int special;          /* descriptor of the pipe or device, or -1 */
};

/* errno in words that say what to do. */
static const char *reason(int code) {
    switch (code) {
    case ENOENT:
        return "there is no such file or folder";
    case EACCES:
    case EPERM:
        return "permission denied";
    case EROFS:
        return "the disk is read-only";
    case ENOSPC:
        return "no space left on the disk";
    case EDQUOT:
        return "the disk quota is used up";
    case EISDIR:
        return "it is a folder";
    case ENOTDIR:
        return "a part of its path is not a folder";
    case ENAMETOOLONG:
        return "the name is too long";
    case EMFILE:
    case ENFILE:
        return "too many files are open";
    default:
        return NULL;
    }
}

static brace_status fail_io(brace_error *error, const char *path, const char *doing, int code) {
    char buffer[128];
    const char *text = reason(code);
    if (text == NULL) {
        text = strerror_r(code, buffer, sizeof buffer); /* the GNU one: it returns the text */
    }
    return core_fail(error, code == ENOMEM ? BRACE_ERROR_MEMORY : BRACE_ERROR_IO, "%s: cannot %s: %s", path, doing,
                     text);
}

static void file_free(core_file *file) {
    if (file->stream != NULL) {
        fclose(file->stream);
    }
    if (file->special >= 0) {
        close(file->special);
    }
    if (file->slot != NULL) {
        unlink(file->slot->path);
        slot_release(file->slot);
    }
    core_free(file->path);
    core_free(file->target);
    core_free(file->name);
    core_free(file);
}

void core_file_abort(core_file *file) {
    if (file != NULL) {
        file_free(file);
    }
}

/* Number of the descriptor that a name stands for; -1: none. */
static int descriptor_of(const char *path) {
    static const char *const folders[] = {"/dev/fd/", "/proc/self/fd/"};
    if (strcmp(path, "/dev/stdout") == 0) {
        return STDOUT_FILENO;
    }
    if (strcmp(path, "/dev/stderr") == 0) {
        return STDERR_FILENO;
    }
    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++) {
        const size_t n = strlen(folders[i]);
        if (strncmp(path, folders[i], n) == 0 && path[n] >= '0' && path[n] <= '9') {
            char *end;
            const long number = strtol(path + n, &end, 10);
            return *end == '\0' && number <= INT_MAX ? (int)number : -1;
        }
    }
    return -1;
}

/* Standard output that the shell redirects goes on where it is: opened anew it would begin at the file's first byte. */
static brace_status open_special(core_file *file, brace_error *error) {
    const int same = descriptor_of(file->path);
    if (same >= 0) {
        const int flags = fcntl(same, F_GETFL);
        errno = flags >= 0 ? EBADF : errno;
        file->special = flags >= 0 && (flags & O_ACCMODE) != O_RDONLY ? fcntl(same, F_DUPFD_CLOEXEC, 0) : -1;
    } else {
        file->special = open(file->path, O_WRONLY | O_CLOEXEC);
    }
    if (file->special < 0) {
        return fail_io(error, file->path, "write to it", errno);
    }
    int fd = memfd_create("brace", MFD_CLOEXEC);
    if (fd < 0) {
        return fail_io(error, file->path, "make a temporary file", errno);
    }
    file->stream = fdopen(fd, "w+b");
    if (file->stream == NULL) {
        int code = errno;
        close(fd);
        return fail_io(error, file->path, "make a temporary file", code);
    }
    char name[64];
    snprintf(name, sizeof name, "/proc/self/fd/%d", fd);
    file->name = core_strdup(name);
    return file->name != NULL ? BRACE_OK : core_fail_memory(error, sizeof name, "a file name");
}

/* The folder of file->target, absolute and without links, into `folder` (PATH_MAX). */
static int resolve(core_file *file, bool exists, char *folder) {
    char full[PATH_MAX];
    if (exists) {
        /* Through a link the file that it points to is replaced, not the link. */
        if (realpath(file->path, full) == NULL) {
            return errno;
        }
        char *slash = strrchr(full, '/');
        size_t n = slash == full ? 1 : (size_t)(slash - full);
        memcpy(folder, full, n);
        folder[n] = '\0';
    } else {
        char copy[PATH_MAX];
        size_t length = strlen(file->path);
        if (length >= sizeof copy) {
            return ENAMETOOLONG;
        }
        memcpy(copy, file->path, length + 1);
        char *slash = strrchr(copy, '/');
        const char *base = slash != NULL ? slash + 1 : copy;
        if (*base == '\0') {
            return length == 0 ? ENOENT : EISDIR;
        }
        if (slash != NULL) {
            *slash = '\0';
        }
        const char *parent = slash == NULL ? "." : slash == copy ? "/" : copy;
        if (realpath(parent, folder) == NULL) {
            return errno;
        }
        int n = snprintf(full, sizeof full, "%s/%s", strcmp(folder, "/") == 0 ? "" : folder, base);
        if (n < 0 || (size_t)n >= sizeof full) {
            return ENAMETOOLONG;
        }
    }
    file->target = core_strdup(full);
    return file->target != NULL ? 0 : ENOMEM;
}

static int open_temporary(core_file *file, const char *folder, mode_t mode) {
    static const char digits[] = "abcdefghijklmnopqrstuvwxyz234567";
    for (int attempt = 0; attempt < 100; attempt++) {
        unsigned char noise[16];
        if (getrandom(noise, sizeof noise, 0) != (ssize_t)sizeof noise) {
            return -1;
        }
        char tail[sizeof noise + 1];
        for (size_t i = 0; i < sizeof noise; i++) {
            tail[i] = digits[noise[i] & 31];
        }
        tail[sizeof noise] = '\0';
        int n = snprintf(file->slot->path, sizeof file->slot->path, "%s/.brace-%s.tmp",
                         strcmp(folder, "/") == 0 ? "" : folder, tail);
        if (n < 0 || (size_t)n >= sizeof file->slot->path) {
            errno = ENAMETOOLONG;
            return -1;
        }
        /* Armed first: a signal between the two would leave the file behind. */
        atomic_store(&file->slot->state, SLOT_ARMED);
        int fd = open(file->slot->path, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, mode);
        if (fd >= 0 || errno != EEXIST) {
            return fd;
        }
        atomic_store(&file->slot->state, SLOT_TAKEN);
    }
    errno = EEXIST;
    return -1;
}

static brace_status open_regular(core_file *file, const struct stat *old, brace_error *error) {
    char folder[PATH_MAX];
    int code = resolve(file, old != NULL, folder);
    if (code == ENOENT) {
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot write: its folder does not exist", file->path);
    }
    if (code != 0) {
        return fail_io(error, file->path, "write", code);
    }
    if (old != NULL && access(file->target, W_OK) != 0) {
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot replace it: the file is write-protected", file->path);
    }
    file->slot = slot_take();
    if (file->slot == NULL) {
        return core_fail_memory(error, sizeof *file->slot, "the name of a temporary file");
    }
    file->slot->path[0] = '\0';
    int fd = open_temporary(file, folder, old != NULL ? old->st_mode & 0600 : 0666);
    if (fd < 0) {
        code = errno;
        /* Nothing of ours is under that name. */
        slot_release(file->slot);
        file->slot = NULL;
        if (code == EACCES || code == EPERM || code == EROFS) {
            return core_fail(error, BRACE_ERROR_IO, "%s: cannot write: its folder (%s) does not allow new files: %s",
                             file->path, folder, reason(code));
        }
        return fail_io(error, file->path, "write", code);
    }
    if (old != NULL) {
        /* The new file keeps mode and, where that is allowed, owner of the one that it replaces. */
        mode_t mode = old->st_mode & 0777;
        if ((old->st_uid != geteuid() || old->st_gid != getegid()) && fchown(fd, old->st_uid, old->st_gid) != 0) {
            mode &= 0707; /* the group's rights were meant for another group */
        }
        if (fchmod(fd, mode) != 0) {
            code = errno;
            close(fd);
            return fail_io(error, file->path, "set the mode of a temporary file", code);
        }
    }
    file->stream = fdopen(fd, "w+b");
    if (file->stream == NULL) {
        code = errno;
        close(fd);
        return fail_io(error, file->path, "write", code);
    }
    file->name = core_strdup(file->slot->path);
    return file->name != NULL ? BRACE_OK : core_fail_memory(error, PATH_MAX, "a file name");
}

brace_status core_file_create(core_file **out, const char *path, brace_error *error) {
    *out = NULL;
    if (path == NULL || *path == '\0') {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "the name of the file to write is empty");
    }
    core_file *file = core_calloc(1, sizeof *file);
    if (file == NULL) {
        return core_fail_memory(error, sizeof *file, "a file");
    }
    file->special = -1;
    file->path = core_strdup(path);
    brace_status status = BRACE_OK;
    struct stat st;
    if (file->path == NULL) {
        status = core_fail_memory(error, strlen(path) + 1, "a file name");
    } else if (stat(path, &st) == 0) {
        if (S_ISDIR(st.st_mode)) {
            status = core_fail(error, BRACE_ERROR_IO, "%s: cannot write: it is a folder, a file name is needed", path);
        } else if (!S_ISREG(st.st_mode) || descriptor_of(path) >= 0 || strncmp(path, "/proc/", 6) == 0) {
            /* /dev/stdout is a regular file when the shell redirects it, and must not be renamed onto. */
            status = open_special(file, error);
        } else {
            status = open_regular(file, &st, error);
        }
    } else if (errno == ENOENT) {
        status = open_regular(file, NULL, error);
    } else {
        status = fail_io(error, path, "write", errno);
    }
    if (status != BRACE_OK) {
        file_free(file);
        return status;
    }
    *out = file;
    return BRACE_OK;
}

FILE *core_file_stream(core_file *file) {
    return file->stream;
}

const char *core_file_temporary(const core_file *file) {
    return file->name;
}

/* Sends the gathered bytes to the pipe or device; 0 or errno. */
static int send_special(core_file *file) {
    int from = fileno(file->stream);
    unsigned char buffer[65536];
    off_t offset = 0;
    for (;;) {
        ssize_t n = pread(from, buffer, sizeof buffer, offset);
        if (n == 0) {
            break;
        }
        if (n < 0) {
            if (errno == EINTR) {
                continue;
            }
            return errno;
        }
        offset += n;
        for (ssize_t sent = 0; sent < n;) {
            ssize_t k = write(file->special, buffer + sent, (size_t)(n - sent));
            if (k > 0) {
                sent += k;
            } else if (k < 0 && errno != EINTR) {
                return errno;
            }
        }
    }
    int code = close(file->special) != 0 ? errno : 0;
    file->special = -1;
    return code;
}

static int sync_folder(const char *target) {
    char folder[PATH_MAX];
    const char *slash = strrchr(target, '/');
    size_t n = slash == target ? 1 : (size_t)(slash - target);
    memcpy(folder, target, n);
    folder[n] = '\0';
    int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) {
        return errno == EACCES ? 0 : errno; /* a folder may be writable and not readable */
    }
    int code = fsync(fd) != 0 ? errno : 0;
    close(fd);
    return code == EINVAL || code == ENOTSUP || code == EROFS ? 0 : code; /* file systems that cannot sync folders */
}

static brace_status commit(core_file *file, bool sync, brace_error *error) {
    brace_status status = BRACE_OK;
    int code = 0;
    errno = 0;
    if (fflush(file->stream) != 0) {
        code = errno != 0 ? errno : EIO;
    } else if (ferror(file->stream)) {
        code = EIO;
    }
    if (code == 0 && file->slot == NULL) {
        code = send_special(file);
    } else if (code == 0) {
        if (!sync) {
#ifdef SYNC_FILE_RANGE_WRITE
            (void)sync_file_range(fileno(file->stream), 0, 0, SYNC_FILE_RANGE_WRITE); /* only a hint */
#endif
        } else if (fsync(fileno(file->stream)) != 0 && errno != EINVAL && errno != ENOTSUP) {
            code = errno;
        }
        int closed = fclose(file->stream);
        file->stream = NULL;
        if (closed != 0 && code == 0) {
            code = errno;
        }
        if (code == 0 && rename(file->slot->path, file->target) != 0) {
            code = errno;
        }
        if (code == 0) {
            slot_release(file->slot);
            file->slot = NULL;
            code = sync ? sync_folder(file->target) : 0;
        }
    }
    if (code != 0) {
        status = fail_io(error, file->path, "write", code);
    }
    file_free(file);
    return status;
}

brace_status core_file_commit(core_file *file, brace_error *error) {
    return commit(file, true, error);
}

brace_status core_file_commit_unsynced(core_file *file, brace_error *error) {
    return commit(file, false, error);
}

brace_status core_folder_sync(const char *path, brace_error *error) {
    int code = 0;
    DIR *dir = opendir(path);
    if (dir == NULL) {
        return fail_io(error, path, "open", errno);
    }
    for (struct dirent *entry; code == 0 && (entry = readdir(dir)) != NULL;) {
        int fd = entry->d_name[0] == '.' ? -1 : openat(dirfd(dir), entry->d_name, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
        if (fd >= 0) {
            if (fsync(fd) != 0 && errno != EINVAL && errno != ENOTSUP) {
                code = errno;
            }
            close(fd);
        }
    }
    if (code == 0 && fsync(dirfd(dir)) != 0 && errno != EINVAL && errno != ENOTSUP && errno != EROFS) {
        code = errno;
    }
    closedir(dir);
    return code == 0 ? BRACE_OK : fail_io(error, path, "write", code);
}

/* ---- reading ---- */

brace_status core_file_load(void **data, size_t *size, const char *path, size_t limit, brace_error *error) {
    *data = NULL;
    *size = 0;
    if (path == NULL || *path == '\0') {
        return core_fail(error, BRACE_ERROR_ARGUMENT, "the name of the file to read is empty");
    }
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK); /* a pipe without a writer must not block */
    if (fd < 0) {
        return fail_io(error, path, "open", errno);
    }
    struct stat st;
    brace_status status = BRACE_OK;
    unsigned char *p = NULL;
    size_t have = 0;
    if (fstat(fd, &st) != 0) {
        status = fail_io(error, path, "open", errno);
    } else if (S_ISDIR(st.st_mode)) {
        status = core_fail(error, BRACE_ERROR_IO, "%s: cannot read: it is a folder, a file is needed", path);
    } else if (!S_ISREG(st.st_mode)) {
        status = core_fail(error, BRACE_ERROR_IO, "%s: cannot read: it is a pipe or device, a file is needed", path);
    } else if ((uintmax_t)st.st_size > limit) {
        status = core_fail(error, BRACE_ERROR_UNSUPPORTED, "%s: the file is too large: %ju bytes, at most %zu are read",
                           path, (uintmax_t)st.st_size, limit);
    } else {
        size_t want = (size_t)st.st_size;
        p = core_alloc(want, 1);
        if (p == NULL) {
            status = core_fail_memory(error, want, path);
        }
        while (status == BRACE_OK && have < want) {
            ssize_t n = read(fd, p + have, want - have);
            if (n > 0) {
                have += (size_t)n;
            } else if (n == 0) {
                break; /* it shrank while being read; what is there is judged by the decoder */
            } else if (errno != EINTR) {
                status = fail_io(error, path, "read", errno);
            }
        }
    }
    close(fd);
    if (status != BRACE_OK) {
        core_free(p);
        return status;
    }
    *data = p;
    *size = have;
    return BRACE_OK;
}

double core_seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

brace_status core_file_map(void **data, size_t *size, const char *path, size_t least, const char *what,
                           brace_error *error) {
    *data = NULL;
    *size = 0;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    struct stat info;
    if (fd < 0 || fstat(fd, &info) != 0) {
        brace_status status = fail_io(error, path, "open", errno);
        if (fd >= 0) {
            close(fd);
        }
        return status;
    }
    if (!S_ISREG(info.st_mode) || (uintmax_t)info.st_size < least || info.st_size == 0) {
        close(fd);
        return core_fail(error, BRACE_ERROR_FORMAT, "%s: no %s", path, what);
    }
    void *map = mmap(NULL, (size_t)info.st_size, PROT_READ, MAP_SHARED, fd, 0);
    int code = errno;
    close(fd);
    if (map == MAP_FAILED) {
        return fail_io(error, path, "map", code);
    }
    *data = map;
    *size = (size_t)info.st_size;
    return BRACE_OK;
}

void core_file_unmap(void *data, size_t size) {
    if (data != NULL) {
        munmap(data, size);
    }
}
