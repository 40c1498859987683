/* SPDX-License-Identifier: Apache-2.0 */
/*
 * run_folder.c: where a sequence lies until it is complete: ".capture-NAME"
 * beside the folder NAME that it becomes, with sequence.json after every good shot. So a
 * crash, a full disk or Ctrl-C cost one frame, and NAME is there as a whole or
 * not at all.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "capture/run.h"
#include "sim/dataset.h"

bool session_path(char *out, const capture_session *s, const char *file) {
    return snprintf(out, PATH_MAX, "%s/%s", s->folder, file) < PATH_MAX;
}

/* Removes the files of a folder and of the folders in it, but for those that `keep` wants (NULL: none). */
static void clear(int parent, const char *name, const char *inside, const capture_session *keep) {
    const int fd = openat(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    DIR *dir = fd >= 0 ? fdopendir(fd) : NULL;
    if (dir == NULL) {
        if (fd >= 0)
            close(fd);
        return;
    }
    for (const struct dirent *entry; (entry = readdir(dir)) != NULL;) {
        char path[512];
        bool wanted = false;
        struct stat info;
        if (strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0)
            continue;
        snprintf(path, sizeof path, "%s%s", inside, entry->d_name);
        for (size_t i = 0; keep != NULL && i < keep->sequence->shot_count; i++)
            wanted = wanted || (keep->sequence->shots[i].done && strcmp(keep->sequence->shots[i].file, path) == 0);
        wanted = wanted || (keep != NULL &&
                            (strcmp(path, "sequence.json") == 0 || strcmp(path, keep->sequence->truth_file) == 0));
        if (wanted || fstatat(dirfd(dir), entry->d_name, &info, AT_SYMLINK_NOFOLLOW) != 0)
            continue;
        if (S_ISDIR(info.st_mode) && inside[0] == '\0') {
            snprintf(path, sizeof path, "%s/", entry->d_name);
            clear(dirfd(dir), entry->d_name, path, keep);
            unlinkat(dirfd(dir), entry->d_name, AT_REMOVEDIR); /* stays if something in it does */
        } else {
            unlinkat(dirfd(dir), entry->d_name, 0);
        }
    }
    closedir(dir);
}

brace_status session_save(const capture_session *s, brace_error *error) {
    char path[PATH_MAX];
    if (!session_path(path, s, "sequence.json"))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%.200s...: the name is too long", s->folder);
    return capture_sequence_save(s->sequence, path, error);
}

/* "a/b//" is "a/b", and its hidden folder "a/.capture-b". */
static brace_status name_folders(capture_session *s, const char *folder, brace_error *error) {
    size_t n = strlen(folder);
    while (n > 1 && folder[n - 1] == '/')
        n--;
    s->final = core_alloc(n + 1, 1);
    s->folder = core_alloc(n + 16, 1);
    if (s->final == NULL || s->folder == NULL)
        return core_fail_memory(error, n, "a name");
    memcpy(s->final, folder, n);
    s->final[n] = '\0';
    const char *slash = strrchr(s->final, '/');
    const char *base = slash != NULL ? slash + 1 : s->final;
    if (*base == '\0' || strcmp(base, ".") == 0 || strcmp(base, "..") == 0 || base[0] == '.')
        return core_fail(error, BRACE_ERROR_ARGUMENT, "'%s' is no name for a new folder", folder);
    snprintf(s->folder, n + 16, "%.*s.capture-%s", (int)(base - s->final), s->final, base);
    s->prefix = strlen(s->folder) + 1;
    return BRACE_OK;
}

brace_status capture_left_of(capture_left *out, const char *folder, brace_error *error) {
    static const char description[] = "sequence.json";
    capture_session s = {0};
    char path[PATH_MAX];
    brace_status status = name_folders(&s, folder, error);
    if (status == BRACE_OK) {
        char *all = dataset_path(s.final, description);
        const bool frames = session_path(path, &s, description) && access(path, F_OK) == 0;
        *out = frames ? CAPTURE_LEFT_FRAMES : CAPTURE_LEFT_NOTHING;
        if (all != NULL && access(all, F_OK) == 0)
            *out = CAPTURE_LEFT_ALL;
        core_free(all);
    }
    core_free(s.final);
    core_free(s.folder);
    return status;
}

static brace_status lock(capture_session *s, brace_error *error) {
    s->lock = open(s->folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (s->lock < 0)
        return core_fail(error, BRACE_ERROR_IO, "%s: cannot open: %s", s->folder, strerror(errno));
    if (flock(s->lock, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
        return core_fail(error, BRACE_ERROR_IO, "another run is shooting %s just now", s->final);
    return BRACE_OK;
}

brace_status session_begin(capture_session *s, const char *folder, brace_error *error) {
    s->lock = -1;
    brace_status status = name_folders(s, folder, error);
    struct stat info;
    if (status != BRACE_OK)
        return status;
    if (lstat(s->final, &info) == 0)
        return core_fail(error, BRACE_ERROR_IO, "%s is there already; choose another folder for the sequence",
                         s->final);
    char path[PATH_MAX];
    if (!session_path(path, s, "sequence.json"))
        return core_fail(error, BRACE_ERROR_ARGUMENT, "%.200s...: the name is too long", folder);
    const bool interrupted = lstat(s->folder, &info) == 0;
    if (!interrupted && s->params->resume)
        return core_fail(error, BRACE_ERROR_IO, "%s: there is no interrupted sequence to go on with", s->final);
    status = dataset_make_folder(s->folder, error);
    if (status == BRACE_OK)
        status = lock(s, error);
    if (status != BRACE_OK)
        return status;
    const bool any = interrupted && access(path, F_OK) == 0; /* one that was killed before its first shot has nothing */
    if (any && !s->params->resume && !s->params->restart) {
        close(s->lock);
        s->lock = -1; /* it is not ours to remove */
        return core_fail(error, BRACE_ERROR_IO,
                         "%s: an interrupted sequence is there; go on with it (--resume), or start over (--restart)",
                         s->final);
    }
    if (any && s->params->resume) {
        status = capture_sequence_load(s->sequence, path, error);
        s->resumed = status == BRACE_OK;
        if (status != BRACE_OK) {
            close(s->lock);
            s->lock = -1;
            return status;
        }
        return BRACE_OK;
    }
    if (s->params->resume)
        return core_fail(error, BRACE_ERROR_IO, "%s: the interrupted sequence has no frames; start over", s->final);
    clear(AT_FDCWD, s->folder, "", NULL);
    return BRACE_OK;
}

brace_status session_tidy(capture_session *s, brace_error *error) {
    clear(AT_FDCWD, s->folder, "", s);
    char parts[PATH_MAX];
    for (size_t i = 0; i < s->sequence->shot_count; i++)
        if (s->sequence->shots[i].part > 0)
            return session_path(parts, s, "parts")
                       ? dataset_make_folder(parts, error)
                       : core_fail(error, BRACE_ERROR_ARGUMENT, "%.200s...: the name is too long", s->folder);
    return BRACE_OK;
}

/* Everything on the disk, then the name. */
static brace_status publish(capture_session *s, brace_error *error) {
    char parts[PATH_MAX];
    struct stat info;
    brace_status status = BRACE_OK;
    clear(AT_FDCWD, s->folder, "", s);
    if (session_path(parts, s, "parts") && stat(parts, &info) == 0)
        status = core_folder_sync(parts, error);
    if (status == BRACE_OK)
        status = core_folder_sync(s->folder, error);
    if (status == BRACE_OK && rename(s->folder, s->final) != 0)
        status =
            core_fail(error, BRACE_ERROR_IO, "%s: cannot give the sequence its name: %s", s->final, strerror(errno));
    if (status == BRACE_OK) {
        /* So that the name outlives a power cut. */
        const char *slash = strrchr(s->final, '/');
        snprintf(parts, sizeof parts, "%.*s", slash != NULL ? (int)(slash - s->final) + 1 : 1,
                 slash != NULL ? s->final : ".");
        const int fd = open(parts, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
        if (fd >= 0) {
            (void)fsync(fd); /* some file systems cannot */
            close(fd);
        }
    }
    return status;
}

brace_status session_end(capture_session *s, brace_status status, brace_error *error) {
    if (status == BRACE_OK)
        status = publish(s, error);
    if (status != BRACE_OK && s->lock >= 0) {
        bool any = false;
        for (size_t i = 0; i < s->sequence->shot_count; i++)
            any = any || s->sequence->shots[i].done;
        if (!any) {
            clear(AT_FDCWD, s->folder, "", NULL);
            rmdir(s->folder);
        }
    }
    if (s->lock >= 0)
        close(s->lock);
    core_free(s->final);
    core_free(s->folder);
    return status;
}
