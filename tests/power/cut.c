// Preloaded into `phalanx`: simulates a power failure at the CUT_AT-th write, rename, removal or sync below CUT_FOLDER. Data that
// is not synced is lost as CUT_LOSES selects: 1 the content of files, 2 new names of files, 3 both. Without a power failure, the
// file CUT_TOLD receives the number of such calls, and the checksums and names that are not synced at the end.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <ftw.h>
#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { MOST = 4096 };
static pthread_mutex_t one = PTHREAD_MUTEX_INITIALIZER;
static long calls;
static ino_t dirty[MOST]; // files written since their last sync; 0: none
static struct { char from[PATH_MAX], to[PATH_MAX]; int done; } *renames;
static int renamed;

static const char *folder(void) { const char *path = getenv("CUT_FOLDER"); return path ? path : "?"; }
static long number(const char *name) { const char *text = getenv(name); return text ? atol(text) : 0; }
static int below(const char *path) {
    size_t length = strlen(folder());
    return !strncmp(path, folder(), length) && (path[length] == '/' || !path[length]);
}

static int path_of(int fd, char *path) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, PATH_MAX - 1);
    path[length < 0 ? 0 : length] = 0;
    return below(path);
}

static int find(ino_t inode) {
    for (int i = 0; i < MOST; i++) if (dirty[i] == inode) return i;
    return -1;
}

static int lose(const char *path, const struct stat *status, int kind, struct FTW *_) {
    return kind == FTW_F && find(status->st_ino) >= 0 ? truncate(path, 0) : 0;
}

static int (*real_rename(void))(const char *, const char *) { return dlsym(RTLD_NEXT, "rename"); }

// Counts a call. The power failure may replace it.
static void count(void) {
    if (++calls != number("CUT_AT")) return;
    if (number("CUT_LOSES") & 1) nftw(folder(), lose, 16, FTW_PHYS);
    for (int i = renamed - 1; i >= 0 && number("CUT_LOSES") & 2; i--)
        if (!renames[i].done) real_rename()(renames[i].to, renames[i].from);
    _exit(137);
}

ssize_t write(int fd, const void *bytes, size_t length) {
    ssize_t (*real)(int, const void *, size_t) = dlsym(RTLD_NEXT, "write");
    char path[PATH_MAX];
    struct stat status;
    if (!path_of(fd, path)) return real(fd, bytes, length);
    pthread_mutex_lock(&one);
    count();
    if (!fstat(fd, &status) && find(status.st_ino) < 0) dirty[find(0)] = status.st_ino;
    ssize_t result = real(fd, bytes, length);
    pthread_mutex_unlock(&one);
    return result;
}

int rename(const char *from, const char *to) {
    if (!below(to)) return real_rename()(from, to);
    pthread_mutex_lock(&one);
    count();
    int result = real_rename()(from, to);
    if (!renames) renames = calloc(MOST, sizeof *renames);
    if (!result) {
        strcpy(renames[renamed].from, from);
        strcpy(renames[renamed++].to, to);
    }
    pthread_mutex_unlock(&one);
    return result;
}

int fsync(int fd) {
    int (*real)(int) = dlsym(RTLD_NEXT, "fsync");
    char path[PATH_MAX];
    struct stat status;
    if (!path_of(fd, path) || fstat(fd, &status)) return real(fd);
    pthread_mutex_lock(&one);
    count();
    if (find(status.st_ino) >= 0) dirty[find(status.st_ino)] = 0;
    for (int i = 0; i < renamed; i++) {
        size_t length = strrchr(renames[i].to, '/') - renames[i].to;
        if (length == strlen(path) && !strncmp(renames[i].to, path, length)) renames[i].done = 1;
    }
    pthread_mutex_unlock(&one);
    return real(fd);
}

int unlink(const char *path) {
    int (*real)(const char *) = dlsym(RTLD_NEXT, "unlink");
    if (below(path)) { pthread_mutex_lock(&one); count(); pthread_mutex_unlock(&one); }
    return real(path);
}

static FILE *told;

static int tell(const char *path, const struct stat *status, int kind, struct FTW *place) {
    if (kind == FTW_F && find(status->st_ino) >= 0 && !strcmp(path + place->base, "checksums.sha256"))
        fprintf(told, "not synced: %s\n", path);
    return 0;
}

__attribute__((destructor)) static void end(void) {
    if (!getenv("CUT_TOLD") || !(told = fopen(getenv("CUT_TOLD"), "w"))) return;
    fprintf(told, "%ld calls\n", calls);
    nftw(folder(), tell, 16, FTW_PHYS);
    for (int i = 0; i < renamed; i++)
        if (!renames[i].done) fprintf(told, "not synced: the name %s\n", renames[i].to);
    fclose(told);
}
