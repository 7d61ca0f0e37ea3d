/* The least that a windowed sender must do, as a measure for what ours costs.
 *
 *   cc -O2 -o peer_sender peer_sender.c && ./peer_sender FILE.gcode TTY
 *
 * Opens a pseudo-terminal raw, numbers and checksums the lines of a file, keeps
 * at most 120 bytes unacknowledged, counts `ok`s. No resend, no check, no
 * journal, no timeout: a printer that asks for a line again, or an answer
 * that is lost, is the end. A real serial port's speed is not set.
 *
 * Exit status 0 when every line was acknowledged and every move made. */
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

enum { WINDOW_BYTES = 120, LINE_BYTES = 256, LINES_MOST = 64 };

static int tty;
static char out[4 * LINE_BYTES]; /* framed, not yet written */
static size_t out_len;
static size_t lens[LINES_MOST]; /* of the lines in flight, a ring */
static unsigned oldest, flying;
static size_t flying_bytes;

static int fail(const char *what) {
    fprintf(stderr, "peer_sender: %s\n", what);
    return -1;
}

static int flush(void) {
    for (size_t at = 0; at < out_len;) {
        ssize_t n = write(tty, out + at, out_len - at);
        if (n <= 0) return fail("cannot write");
        at += (size_t)n;
    }
    out_len = 0;
    return 0;
}

/* Reads what is there, waiting for the first byte; counts the answers. */
static int answers(void) {
    static char line[LINE_BYTES];
    static size_t len;
    char in[4096];
    ssize_t n = read(tty, in, sizeof in);
    if (n <= 0) return fail("the printer is gone");
    for (ssize_t i = 0; i < n; i++) {
        if (in[i] != '\n') {
            if (in[i] != '\r' && len < sizeof line - 1) line[len++] = in[i];
            continue;
        }
        line[len] = 0;
        len = 0;
        if (line[0] == 'o' && line[1] == 'k' && flying > 0) {
            flying_bytes -= lens[oldest];
            oldest = (oldest + 1) % LINES_MOST;
            flying--;
        } else if (!strncmp(line, "Resend", 6) || !strncmp(line, "Error", 5)) {
            return fail(line);
        }
    }
    return 0;
}

static int drained(void) {
    if (flush()) return -1;
    while (flying > 0)
        if (answers()) return -1;
    return 0;
}

/* Frames a command and lets it go as soon as the window has room. */
static int put(unsigned n, const char *command) {
    char framed[LINE_BYTES + 32];
    int len = snprintf(framed, sizeof framed, "N%u %s", n, command);
    unsigned char sum = 0;
    for (int i = 0; i < len; i++) sum ^= (unsigned char)framed[i];
    len += snprintf(framed + len, sizeof framed - (size_t)len, "*%u\n", sum);
    while (flying > 0 && (flying_bytes + (size_t)len > WINDOW_BYTES || flying == LINES_MOST))
        if (flush() || answers()) return -1;
    memcpy(out + out_len, framed, (size_t)len);
    out_len += (size_t)len;
    lens[(oldest + flying++) % LINES_MOST] = (size_t)len;
    flying_bytes += (size_t)len;
    return 0;
}

static int stream(FILE *file) {
    char line[LINE_BYTES];
    unsigned n = 0;
    if (put(n, "M110 N0") || drained()) return -1;
    while (fgets(line, sizeof line, file)) {
        size_t len = strcspn(line, ";\r\n");
        while (len > 0 && (line[len - 1] == ' ' || line[len - 1] == '\t')) len--;
        line[len] = 0;
        if (len > 0 && put(++n, line)) return -1;
    }
    return put(++n, "M400") || drained();
}

int main(int argc, char **argv) {
    struct termios raw;
    if (argc != 3) return fail("FILE.gcode TTY") + 3;
    FILE *file = fopen(argv[1], "r");
    if (!file) return fail("cannot open the file") + 2;
    tty = open(argv[2], O_RDWR | O_NOCTTY);
    if (tty < 0 || tcgetattr(tty, &raw)) return fail("cannot open the port") + 2;
    cfmakeraw(&raw);
    if (tcsetattr(tty, TCSANOW, &raw)) return fail("cannot set the port") + 2;
    return stream(file) ? 1 : 0;
}
