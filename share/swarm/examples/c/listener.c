/* An application in C, written from share/doc/protocol.md (its sections are in brackets) without any library:
 * prints each new pose of another vehicle, and answers requests to cmd/echo with the text that they hold.
 *
 *     cc -std=c11 -O2 -o listener listener.c -lm
 *     ./listener /etc/swarm /uav1/nav/pose       configuration folder of the node to join, board of type Pose
 *     swarmctl tree set /gcs/cmd/echo hello      as an operator; `swarmctl app ls` lists the application
 */
#define _GNU_SOURCE
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "frames are little-endian: `get` and `put` must swap");
#define NAME "listener"
#define ECHO "cmd/echo"
enum { BOARD = 1, ACK = 5, REQUEST = 6, REPLY = 7 }; /* kinds of frames [2] */
enum { HEADER = 48, FRAME_MAX = (4 << 20) + 303, ANSWER_MAX = 4096, PACKED = 7, PEERS = 16 };

static volatile sig_atomic_t ending;

static void on_signal(int number) { (void)number, ending = 1; }

static void die(const char *format, ...) {
    va_list args;
    va_start(args, format);
    fprintf(stderr, NAME ": "), vfprintf(stderr, format, args), fputc('\n', stderr);
    exit(1);
}
static const char *text(const char *format, ...) { /* formatted, in one of eight buffers */
    static char buffers[8][PATH_MAX];
    static int next;
    char *out = buffers[next++ % 8];
    va_list args;
    va_start(args, format);
    if (vsnprintf(out, PATH_MAX, format, args) >= PATH_MAX) die("a path is too long");
    va_end(args);
    return out;
}
static uint64_t get(const uint8_t *at, int bytes) { uint64_t n = 0; memcpy(&n, at, bytes); return n; }
static void put(uint8_t *at, uint64_t n, int bytes) { memcpy(at, &n, bytes); }

/* -- checksums [9], numbers for names [1] */

static uint32_t crc32(uint32_t start, const void *data, size_t length) {
    uint32_t crc = ~start;
    for (const uint8_t *at = data; length--; at++) {
        crc ^= *at;
        for (int bit = 0; bit < 8; bit++) crc = crc >> 1 ^ (crc & 1 ? 0xEDB88320 : 0);
    }
    return ~crc;
}
static uint64_t rotated(uint64_t x, int n) { return x >> n | x << (64 - n); }

static uint32_t name_id(const char *name) { /* BLAKE2b-32 (RFC 7693) of up to 128 bytes: one block */
    static const uint64_t iv[8] = {
        0x6a09e667f3bcc908, 0xbb67ae8584caa73b, 0x3c6ef372fe94f82b, 0xa54ff53a5f1d36f1,
        0x510e527fade682d1, 0x9b05688c2b3e6c1f, 0x1f83d9abfb41bd6b, 0x5be0cd19137e2179};
    static const uint64_t sigma[10] = {
        0x0123456789abcdef, 0xea489fd61c02b753, 0xb8c052fdae367194, 0x7931dcbe265a40f8, 0x905724afe1bc683d,
        0x2c6a0b834d75fe19, 0xc51fed4a0763928b, 0xdb7ec13950f4862a, 0x6fe9b308c2d714a5, 0xa2847615fb9e3cd0};
    uint64_t h0 = iv[0] ^ 0x01010000 ^ 4, v[16], m[16] = {0};
    size_t length = strlen(name);
    if (length > sizeof m) die("%s: this example takes paths of 100 bytes at most", name);
    memcpy(m, name, length);
    memcpy(v, iv, sizeof iv), memcpy(v + 8, iv, sizeof iv);
    v[0] = h0, v[12] ^= length, v[14] = ~v[14];
    for (int round = 0; round < 12; round++) {
        for (int i = 0; i < 8; i++) { /* four columns, then four diagonals */
            uint64_t x = m[sigma[round % 10] >> (60 - 8 * i) & 15], y = m[sigma[round % 10] >> (56 - 8 * i) & 15];
            int turn = i / 4;
            uint64_t *a = v + i % 4, *b = v + 4 + (i + turn) % 4;
            uint64_t *c = v + 8 + (i + 2 * turn) % 4, *d = v + 12 + (i + 3 * turn) % 4;
            *a += *b + x, *d = rotated(*d ^ *a, 32), *c += *d, *b = rotated(*b ^ *c, 24);
            *a += *b + y, *d = rotated(*d ^ *a, 16), *c += *d, *b = rotated(*b ^ *c, 63);
        }
    }
    uint32_t id = (uint32_t)(h0 ^ v[0] ^ v[8]);
    return id == 0 || id == 0xFFFFFFFF ? 1 : id;
}

/* -- the node that is joined [8] */

static char platform[32] = "uav1", unit[32] = "main", run_dir[PATH_MAX] = "/run/swarm", shm_dir[PATH_MAX];
static double offset_s, drift_ppm;

static void load_node(const char *folder) { /* the keys of node.toml that matter here */
    FILE *file = fopen(text("%s/node.toml", folder), "r");
    if (!file) die("%s/node.toml: %s; expected the configuration folder of a node", folder, strerror(errno));
    char line[PATH_MAX], table[64] = "";
    while (fgets(line, sizeof line, file)) {
        sscanf(line, " [%63[^]]", table);
        if (!*table) {
            sscanf(line, " platform = \"%31[^\"]", platform), sscanf(line, " unit = \"%31[^\"]", unit);
            sscanf(line, " run_dir = \"%4000[^\"]", run_dir), sscanf(line, " shm_dir = \"%4000[^\"]", shm_dir);
        } else if (!strcmp(table, "clock")) {
            sscanf(line, " offset_s = %lf", &offset_s), sscanf(line, " drift_ppm = %lf", &drift_ppm);
        }
    }
    fclose(file);
    if (!*shm_dir) snprintf(shm_dir, PATH_MAX, "/dev/shm/swarm-%s", platform);
}
static int64_t now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    int64_t mono = now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
    __int128 drift = (__int128)mono * llrint(drift_ppm * 1000), billion = 1000000000;
    return mono + (int64_t)(drift / billion - (drift % billion < 0)) + llrint(offset_s * 1e9);
}
static uint64_t start_ticks(void) {
    char line[1024] = "", *at;
    int fd = open("/proc/self/stat", O_RDONLY | O_CLOEXEC);
    if (read(fd, line, sizeof line - 1) < 0 || !(at = strrchr(line, ')'))) die("/proc/self/stat: cannot be read");
    close(fd);
    for (int field = 2; at && field < 22; field++) at = strchr(at + 1, ' ');
    return at ? strtoull(at, NULL, 10) : 0;
}
static bool lock_within(int fd, int tries) {
    while (flock(fd, LOCK_EX | LOCK_NB) < 0) {
        if (--tries <= 0) return false;
        nanosleep(&(struct timespec){0, 500000}, NULL);
    }
    return true;
}
static bool stands_at(int fd, const char *path) {
    struct stat ours, found;
    return !fstat(fd, &ours) && !lstat(path, &found) && ours.st_dev == found.st_dev && ours.st_ino == found.st_ino;
}
static void join_node(void) { /* the lock ends with this process */
    int fd = open(text("%s/boot", run_dir), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    if (fd < 0 || !flock(fd, LOCK_EX | LOCK_NB)) die("%s: this node does not run; expected its services", run_dir);
    flock(fd, LOCK_SH);
}

/* -- the doorbell [10] */

static char bell_name[48];

static int make_doorbell(void) {
    const char *folder = text("%s/bells", run_dir);
    int lock = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (lock < 0 || !lock_within(lock, 2000)) die("%s: cannot be locked", folder);
    for (int n = 0;; n++) {
        snprintf(bell_name, sizeof bell_name, "%d-%d", getpid(), n);
        const char *path = text("%s/%s", folder, bell_name);
        if (mkfifo(path, 0600) == 0) break;
        int heard = open(path, O_WRONLY | O_NONBLOCK | O_CLOEXEC);
        if (heard >= 0) close(heard);
        else if (errno == ENXIO && unlink(path) == 0) n--; /* of a dead process that had our number */
    }
    int bell = open(text("%s/%s", folder, bell_name), O_RDWR | O_NONBLOCK | O_CLOEXEC);
    close(lock);
    return bell;
}
static void ring_bells(const char *readers) {
    DIR *folder = opendir(readers);
    for (struct dirent *one; folder && (one = readdir(folder));) {
        if (*one->d_name == '.') continue;
        int fd = open(text("%s/bells/%s", run_dir, one->d_name), O_WRONLY | O_NONBLOCK | O_CLOEXEC);
        if (fd >= 0 && write(fd, "\1", 1) < 0 && errno != EAGAIN) perror(one->d_name);
        if (fd >= 0) close(fd);
    }
    if (folder) closedir(folder);
}
static void listen_to(const char *ring) { /* an entry for `…/nav.pose.ring` in `…/nav.pose.readers` */
    const char *readers = text("%.*s.readers", (int)strlen(ring) - 5, ring), *entry = text("%s/%s", readers, bell_name);
    if (access(entry, F_OK) == 0) return;
    mkdir(text("%.*s", (int)(strrchr(ring, '/') - ring), ring), 0700);
    if (mkdir(readers, 01770) == 0) chmod(readers, 01770);
    int fd = open(entry, O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    int folder = open(readers, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0 || folder < 0 || futimens(folder, NULL) < 0) die("%s: %s", entry, strerror(errno));
    close(fd), close(folder);
}

/* -- the application file [11] */

static char file_path[PATH_MAX], endpoint[PATH_MAX];

static void announce(void) {
    int folder = open(text("%s/apps", run_dir), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    struct timespec now[2];
    clock_gettime(CLOCK_REALTIME, &now[0]), now[1] = now[0];
    if (folder < 0 || futimens(folder, now) < 0) perror("apps");
    close(folder);
    ring_bells(text("%s/apps.readers", shm_dir));
}
static int claim_file(int *instance) {
    for (*instance = 1; *instance < 64;) {
        strcpy(file_path, text("%s/apps/" NAME "#%d.toml", run_dir, *instance));
        int fd = open(file_path, O_RDWR | O_CLOEXEC | O_NOFOLLOW);
        bool missing = fd < 0 && errno == ENOENT;
        if (missing) fd = open(file_path, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
        bool created_by_other = missing && fd < 0 && errno == EEXIST, locked = fd >= 0 && lock_within(fd, 200);
        if (locked && stands_at(fd, file_path)) return fd;
        if (fd >= 0) close(fd);
        if (!locked && !created_by_other) ++*instance; /* else another process removed or created it: once more */
    }
    die("%s: %s; expected a free instance", file_path, strerror(errno));
    return -1;
}
static void write_file(int fd, int instance, const char *board) {
    char out[4096];
    int length = snprintf(
        out, sizeof out,
        "name = \"" NAME "\"\ninstance = %d\npid = %d\npid_start = %" PRIu64 "\nstarted_ns = %" PRId64 "\n"
        "endpoint = \"ipc://%s\"\nreads = [\"%s\"]\n"
        "serves = [{path = \"" ECHO "\", type = \"Text\", kind = \"request\"}]\n\n"
        "[[provides]]\npath = \"" ECHO "\"\nkind = \"command\"\ntype = \"Text\"\nreply = \"Text\"\n"
        "access = \"rw\"\nowner = \"" NAME "\"\ndescription = \"Answers with the same text\"\n",
        instance, getpid(), start_ticks(), now_ns(), endpoint, board);
    length += snprintf(out + length, sizeof out - length, "# crc32 %08x\n", crc32(0, out, length));
    if (pwrite(fd, out, length, 0) != length || ftruncate(fd, length)) die("%s: %s", file_path, strerror(errno));
    unlink(text("%.*s.dead", (int)strlen(file_path) - 5, file_path));
    announce();
}

/* -- the ring of the board [9], and the Pose in it [2, types.md] */

static struct {
    char path[PATH_MAX];
    const uint64_t *words;
    uint64_t bytes, slots, slot_bytes, stride, epoch, seen;
} ring;

static uint64_t word(size_t at) { return __atomic_load_n(ring.words + at / 8, __ATOMIC_ACQUIRE); }

static void open_ring(void) {
    int fd = open(ring.path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    struct stat file;
    if (fd < 0) return; /* nobody writes it yet, or any more */
    if (fstat(fd, &file) || !S_ISREG(file.st_mode) || file.st_size < 256) die("%s: no ring", ring.path);
    if (ring.words) munmap((void *)ring.words, ring.bytes);
    ring.bytes = file.st_size;
    ring.words = mmap(NULL, ring.bytes, PROT_READ, MAP_SHARED, fd, 0);
    close(fd);
    if (ring.words == MAP_FAILED) die("%s: %s", ring.path, strerror(errno));
    uint64_t fixed[7] = {word(0), word(8), word(24), word(32), word(40), word(48), word(56)};
    ring.slots = word(24), ring.slot_bytes = word(32), ring.stride = (32 + ring.slot_bytes + 63) / 64 * 64;
    if (memcmp(ring.words, "SWARMRNG", 8) || word(8) != 1 || word(64) != crc32(0, fixed, sizeof fixed)
        || ring.bytes != 256 + ring.slots * ring.stride) die("%s: no ring of version 1", ring.path);
    if (ring.epoch != word(48)) ring.epoch = word(48), ring.seen = 0;
}
static size_t newest(uint8_t *frame) { /* its length; 0 when there is none that was not seen */
    if (!ring.words || word(16)) open_ring();
    for (int attempt = 0; ring.words && attempt < 1000; attempt++) {
        uint64_t n = word(128), slot = 256 + n % ring.slots * ring.stride;
        if (n == word(56) || n == ring.seen) return 0;
        if (word(slot + 8) != n) continue;
        uint64_t meta = word(slot + 16), length = meta & 0xFFFFFFFF;
        if (length > ring.slot_bytes || length > FRAME_MAX) continue;
        memcpy(frame, ring.words + (slot + 32) / 8, length);
        __atomic_thread_fence(__ATOMIC_ACQUIRE);
        if (word(slot) != n) continue;
        if (ring.slot_bytes <= 65536 && crc32((uint32_t)n, frame, length) != meta >> 32) continue;
        ring.seen = n;
        return length;
    }
    if (ring.words) die("%s: a frame is never whole; expected one writer", ring.path);
    return 0;
}
static void show(const uint8_t *frame, size_t length, uint32_t data_id) {
    if (length < HEADER || memcmp(frame, "SW", 2) || frame[3] != BOARD || get(frame + 8, 4) != data_id) return;
    const uint8_t *at = frame + HEADER + frame[7], *end = frame + length;
    double x[3] = {NAN, NAN, NAN};
    if ((frame[5] & 7) == PACKED && (end - at == 23 || end - at == 26)) { /* codec: bits 8–10 of the flags */
        int bytes = end - at == 23 ? 3 : 4, unused = 32 - 8 * bytes;
        for (int i = 0; i < 3; i++) x[i] = ((int32_t)(get(at + i * bytes, bytes) << unused) >> unused) / 1000.0;
    } else if (end - at > 27 && *at++ >= 0x93) { /* MessagePack of a Pose: an array that begins with three float 64 */
        for (int i = 0; i < 3 && *at == 0xCB; i++, at += 9) {
            uint64_t bits = __builtin_bswap64(get(at + 1, 8));
            memcpy(&x[i], &bits, 8);
        }
    }
    printf("%.3f %.3f %.3f at %.3f s\n", x[0], x[1], x[2], (int64_t)get(frame + 32, 8) / 1e9);
    fflush(stdout);
}

/* -- requests: a ROUTER of ZMTP with NULL [12] */

static struct { int fd; bool greeted; size_t have; uint8_t *in; } peers[PEERS];

static int bind_endpoint(void) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    strcpy(endpoint, text("%s/p/%s.sock", run_dir, bell_name));
    if (strlen(endpoint) >= sizeof address.sun_path) die("%s: too long for a socket", endpoint);
    strcpy(address.sun_path, endpoint);
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    unlink(endpoint);
    if (bind(fd, (void *)&address, sizeof address) || listen(fd, PEERS)) die("%s: %s", endpoint, strerror(errno));
    return fd;
}
static void hang_up(int i) { close(peers[i].fd), free(peers[i].in), memset(&peers[i], 0, sizeof peers[i]); }

static void transmit(int i, const void *data, ssize_t length) { /* who does not read has to connect again */
    if (send(peers[i].fd, data, length, MSG_NOSIGNAL | MSG_DONTWAIT) != length) shutdown(peers[i].fd, SHUT_RDWR);
}
static void welcome(int socket) {
    static const uint8_t greeting[64] = {0xFF, [9] = 0x7F, 3, 1, 'N', 'U', 'L', 'L'};
    static const uint8_t ready[] = "\x04\x1c\x05READY\x0bSocket-Type\0\0\0\x06ROUTER";
    int fd = accept4(socket, NULL, NULL, SOCK_CLOEXEC), i = 0;
    while (i < PEERS && peers[i].in) i++;
    if (fd < 0 || i == PEERS || !(peers[i].in = malloc(FRAME_MAX + 9))) { close(fd); return; }
    peers[i].fd = fd;
    transmit(i, greeting, sizeof greeting), transmit(i, ready, sizeof ready - 1);
}
static void answer(int i, const uint8_t *question, size_t length, uint32_t data_id) {
    uint8_t out[ANSWER_MAX], *frame = out + 9, *payload = frame + HEADER;
    size_t start = HEADER + question[7], size = length - start, used;
    bool ours = question[3] == REQUEST && get(question + 8, 4) == data_id;
    if (question[3] == ACK || question[3] == REPLY || length <= start) return;
    if (!ours) { /* Ack: [4, platform, ""] */
        used = sprintf((char *)payload, "\x93\x04%c%s\xa0", 0xa0 | (int)strlen(platform), platform);
    } else if (size < ANSWER_MAX - 128 && !(question[5] & 7) && question[start] == 0x91) { /* Reply: [true, body] */
        /* nothing is done, so a repeated question needs no memory of its answer, nor a late one its lifetime [13] */
        memcpy(payload, "\x92\xc3\xc5", 3), payload[3] = size >> 8, payload[4] = size & 0xFF;
        memcpy(payload + 5, question + start, size), used = size + 5;
    } else { /* Reply: [false, "", kind, error] */
        static const char error[] = "\x94\xc2\xc4\0\xa9WireError\xd9\x29" ECHO ": no Text; expected a short array";
        memcpy(payload, error, used = sizeof error - 1);
    }
    memcpy(frame, question, HEADER); /* magic, version, data id and sequence are those of the question */
    frame[3] = ours ? REPLY : ACK, frame[4] &= 2, frame[5] = 0, frame[6] = 24, frame[7] = 0;
    put(frame + 12, name_id(text("%s.%s", platform, unit)), 4), memcpy(frame + 16, question + 24, 4);
    memcpy(frame + 20, question + 12, 8), put(frame + 32, now_ns(), 8), put(frame + 40, 0, 8);
    out[0] = 2, used += HEADER;
    put(out + 1, __builtin_bswap64(used), 8);
    transmit(i, out, used + 9);
}
static void receive(int i, uint32_t data_id) {
    uint8_t *in = peers[i].in;
    ssize_t got = recv(peers[i].fd, in + peers[i].have, FRAME_MAX + 9 - peers[i].have, MSG_DONTWAIT);
    if (got == 0 || (got < 0 && errno != EAGAIN)) { hang_up(i); return; }
    for (peers[i].have += got > 0 ? got : 0;;) {
        bool greeted = peers[i].greeted;
        size_t head = !greeted ? 64 : *in & 2 ? 9 : 2, length = 0;
        if (peers[i].have < head) return;
        if (greeted) length = head == 2 ? in[1] : __builtin_bswap64(get(in + 1, 8));
        if (length > FRAME_MAX || (!greeted && (*in != 0xFF || memcmp(in + 12, "NULL", 5)))) { hang_up(i); return; }
        if (peers[i].have < head + length) return;
        /* commands (bit 2), READY among them, need no answer */
        bool frame = greeted && !(*in & 5) && length >= HEADER && !memcmp(in + head, "SW", 2);
        if (frame) answer(i, in + head, length, data_id);
        peers[i].greeted = true;
        memmove(in, in + head + length, peers[i].have -= head + length);
    }
}

int main(int count, char **words) {
    const char *board = count == 3 ? words[2] : "", *local = *board == '/' ? strchr(board + 1, '/') : NULL;
    if (!local || strpbrk(board, "\"\\.*{")) die("expected a configuration folder and a path, such as /uav1/nav/pose");
    uint32_t echo_id = name_id(ECHO ":Text"), pose_id = name_id(text("%s:Pose", local + 1));
    sigaction(SIGTERM, &(struct sigaction){.sa_handler = on_signal}, NULL);
    sigaction(SIGINT, &(struct sigaction){.sa_handler = on_signal}, NULL);
    load_node(words[1]), join_node();
    int bell = make_doorbell(), socket = bind_endpoint(), instance, file = claim_file(&instance);
    write_file(file, instance, board);

    strcpy(ring.path, text("%s%.*s/%s.ring", shm_dir, (int)(local - board), board, local + 1));
    for (char *at = ring.path + strlen(shm_dir) + (local - board) + 1; (at = strchr(at, '/'));) *at = '.';
    static uint8_t frame[FRAME_MAX];
    while (!ending) {
        struct pollfd fds[2 + PEERS] = {{bell, POLLIN, 0}, {socket, POLLIN, 0}};
        for (int i = 0; i < PEERS; i++) fds[2 + i] = (struct pollfd){peers[i].in ? peers[i].fd : -1, POLLIN, 0};
        listen_to(ring.path); /* before the look: whatever is written from now on rings */
        for (size_t length; (length = newest(frame));) show(frame, length, pose_id);
        if (poll(fds, 2 + PEERS, 1000) <= 0) continue;
        while (fds[0].revents && read(bell, frame, 4096) > 0) {}
        for (int i = 0; i < PEERS; i++) if (fds[2 + i].revents) receive(i, echo_id);
        if (fds[1].revents) welcome(socket);
    }
    unlink(text("%.*s.readers/%s", (int)strlen(ring.path) - 5, ring.path, bell_name));
    unlink(file_path), close(file), announce();
    unlink(endpoint), unlink(text("%s/bells/%s", run_dir, bell_name));
    return 0;
}
