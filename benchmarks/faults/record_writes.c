/* Preloaded into a process: appends each change that it makes to a file under $RECORD_UNDER to $RECORD_TO, in order.

   A record is: operation (1 byte), inode, offset, length (8 bytes each), length of the text (4 bytes), text, data.
   W: write, T: truncate to `length`, S: fsync, C: the name exists from now on, R: rename and L: link (text: old NUL new), U: unlink. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static int record_fd = -1;
static const char *under;

#define NEXT(name) ((typeof(&name))dlsym(RTLD_NEXT, #name))

static void put(const void *data, size_t length) {
  const char *at = data;
  while (length > 0) {
    ssize_t done = NEXT(write)(record_fd, at, length);
    if (done <= 0) abort();
    at += done;
    length -= (size_t)done;
  }
}

static void record(char operation, uint64_t inode, uint64_t offset, uint64_t length, const char *text, uint32_t text_length, const void *data) {
  pthread_mutex_lock(&lock);
  if (record_fd < 0) record_fd = NEXT(open)(getenv("RECORD_TO"), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  put(&operation, 1);
  put(&inode, 8);
  put(&offset, 8);
  put(&length, 8);
  put(&text_length, 4);
  put(text, text_length);
  if (data) put(data, length);
  pthread_mutex_unlock(&lock);
}

static int watched(const char *path) {
  if (!under) under = getenv("RECORD_UNDER");
  return under && path && strncmp(path, under, strlen(under)) == 0;
}

/* The path of a name in an open folder. */
static const char *full(int folder, const char *path, char *buffer, size_t size) {
  char link[64];
  if (path[0] == '/' || folder == AT_FDCWD) return path;
  snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
  ssize_t length = readlink(link, buffer, size - 1);
  if (length < 0 || snprintf(buffer + length, size - (size_t)length, "/%s", path) >= (int)(size - (size_t)length)) return path;
  return buffer;
}

static int watched_fd(int fd, uint64_t *inode, char *path, size_t size) {
  char link[64];
  struct stat status;
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  ssize_t length = readlink(link, path, size - 1);
  if (length < 0) return 0;
  path[length] = 0;
  if (!watched(path) || fstat(fd, &status)) return 0;
  *inode = status.st_ino;
  return 1;
}

static int opened(int fd, int flags) {
  char path[4096];
  uint64_t inode;
  if (fd >= 0 && (flags & O_CREAT) && watched_fd(fd, &inode, path, sizeof path)) record('C', inode, 0, 0, path, strlen(path), NULL);
  if (fd >= 0 && (flags & O_TRUNC) && watched_fd(fd, &inode, path, sizeof path)) record('T', inode, 0, 0, path, strlen(path), NULL);
  return fd;
}

#define MODE(last) mode_t mode = 0; if (flags & O_CREAT) { va_list list; va_start(list, last); mode = va_arg(list, mode_t); va_end(list); }
int open(const char *path, int flags, ...) { MODE(flags) return opened(NEXT(open)(path, flags, mode), flags); }
int open64(const char *path, int flags, ...) { MODE(flags) return opened(NEXT(open64)(path, flags, mode), flags); }
int openat(int folder, const char *path, int flags, ...) { MODE(flags) return opened(NEXT(openat)(folder, path, flags, mode), flags); }
int openat64(int folder, const char *path, int flags, ...) { MODE(flags) return opened(NEXT(openat64)(folder, path, flags, mode), flags); }

static ssize_t wrote(int fd, const void *data, ssize_t done, off_t offset) {
  char path[4096];
  uint64_t inode;
  if (done > 0 && watched_fd(fd, &inode, path, sizeof path)) record('W', inode, (uint64_t)offset, (uint64_t)done, path, strlen(path), data);
  return done;
}

ssize_t write(int fd, const void *data, size_t length) {
  off_t offset = lseek(fd, 0, SEEK_CUR);
  int flags = fcntl(fd, F_GETFL);
  struct stat status;
  if (flags >= 0 && (flags & O_APPEND) && fstat(fd, &status) == 0) offset = status.st_size;
  return wrote(fd, data, NEXT(write)(fd, data, length), offset);
}
ssize_t pwrite(int fd, const void *data, size_t length, off_t offset) { return wrote(fd, data, NEXT(pwrite)(fd, data, length, offset), offset); }
ssize_t pwrite64(int fd, const void *data, size_t length, off64_t offset) { return wrote(fd, data, NEXT(pwrite64)(fd, data, length, offset), offset); }

static int truncated(int fd, int result, off_t length) {
  char path[4096];
  uint64_t inode;
  if (result == 0 && watched_fd(fd, &inode, path, sizeof path)) record('T', inode, 0, (uint64_t)length, path, strlen(path), NULL);
  return result;
}
int ftruncate(int fd, off_t length) { return truncated(fd, NEXT(ftruncate)(fd, length), length); }
int ftruncate64(int fd, off64_t length) { return truncated(fd, NEXT(ftruncate64)(fd, length), length); }

static int synced(int fd, int result) {
  char path[4096];
  uint64_t inode;
  if (result == 0 && watched_fd(fd, &inode, path, sizeof path)) record('S', inode, 0, 0, path, strlen(path), NULL);
  return result;
}
int fsync(int fd) { return synced(fd, NEXT(fsync)(fd)); }
int fdatasync(int fd) { return synced(fd, NEXT(fdatasync)(fd)); }

static int named(char operation, const char *from, const char *to, int result) {
  char both[8192];
  if (result == 0 && watched(to)) {
    int length = snprintf(both, sizeof both, "%s%c%s", from, 0, to);
    record(operation, 0, 0, 0, both, (uint32_t)length, NULL);
  }
  return result;
}
int rename(const char *from, const char *to) { return named('R', from, to, NEXT(rename)(from, to)); }
int renameat(int a, const char *from, int b, const char *to) {
  char first[4096], second[4096];
  return named('R', full(a, from, first, sizeof first), full(b, to, second, sizeof second), NEXT(renameat)(a, from, b, to));
}
int link(const char *from, const char *to) { return named('L', from, to, NEXT(link)(from, to)); }
int linkat(int a, const char *from, int b, const char *to, int flags) {
  char first[4096], second[4096];
  return named('L', full(a, from, first, sizeof first), full(b, to, second, sizeof second), NEXT(linkat)(a, from, b, to, flags));
}

static int unlinked(const char *path, int result) {
  if (result == 0 && watched(path)) record('U', 0, 0, 0, path, strlen(path), NULL);
  return result;
}
int unlink(const char *path) { return unlinked(path, NEXT(unlink)(path)); }
int unlinkat(int folder, const char *path, int flags) {
  char buffer[4096];
  return unlinked(full(folder, path, buffer, sizeof buffer), NEXT(unlinkat)(folder, path, flags));
}
