/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_protocol.c: messages survive the way to bytes and back, nothing else is
 * taken for one, and a channel waits no longer than it was told to.
 */
#include <math.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cmocka.h>
#include <zlib.h>

#include "capture/channel.h"
#include "core/core.h"

#include "samples.h"

static uint8_t bytes[CAPTURE_WIRE_MESSAGE];

static void test_round_trip(void **state) {
    (void)state;
    for (int i = 0; i < SAMPLES; i++) {
        const capture_message m = sample(i);
        const size_t n = capture_message_write(&m, bytes, sizeof bytes);
        assert_true(n >= CAPTURE_WIRE_HEADER);
        capture_message back;
        size_t used = 0;
        const char *why = NULL;
        assert_int_equal(capture_message_parse(&back, bytes, n, &used, &why), CAPTURE_WIRE_OK);
        assert_int_equal(used, n);
        if (m.type == CAPTURE_WIRE_DATA) {
            assert_int_equal(back.data.size, m.data.size);
            assert_memory_equal(back.data.bytes, m.data.bytes, m.data.size);
            assert_ptr_equal(back.data.bytes, bytes + CAPTURE_WIRE_HEADER + 8);
            back.data.bytes = m.data.bytes;
        }
        assert_memory_equal(&back, &m, sizeof m);
        assert_string_not_equal(capture_wire_name((unsigned)m.type), "?");
        /* More bytes after it are not touched; fewer are not enough, to write or to read. */
        assert_int_equal(capture_message_parse(&back, bytes, sizeof bytes, &used, &why), CAPTURE_WIRE_OK);
        assert_int_equal(used, n);
        uint8_t *exact = malloc(n);
        assert_int_equal(capture_message_write(&m, exact, n), n);
        assert_memory_equal(exact, bytes, n);
        for (size_t size = 0; size < n; size++) {
            assert_int_equal(capture_message_write(&m, exact, size), 0);
            assert_int_equal(capture_message_parse(&back, bytes, size, &used, &why), CAPTURE_WIRE_MORE);
            assert_in_range(used, size + 1, n);
        }
        free(exact);
    }
    assert_string_equal(capture_wire_name(0), "?");
    assert_string_equal(capture_wire_name(12), "?");
}

/* Any one byte that is changed on the way is noticed. */
static void test_damage(void **state) {
    (void)state;
    for (int i = 0; i < SAMPLES; i++) {
        const capture_message m = sample(i);
        const size_t n = capture_message_write(&m, bytes, sizeof bytes);
        for (size_t at = 0; at < n; at++) {
            for (unsigned bit = 1; bit < 256; bit <<= 1) {
                capture_message back;
                size_t used = 0;
                const char *why = NULL;
                bytes[at] ^= (uint8_t)bit;
                const capture_wire_result result = capture_message_parse(&back, bytes, n, &used, &why);
                bytes[at] ^= (uint8_t)bit;
                assert_int_not_equal(result, CAPTURE_WIRE_OK);
                assert_true(used <= CAPTURE_WIRE_MESSAGE);
            }
        }
    }
}

/* The checksum is that of zlib and everyone, so that other programs can speak the protocol. */
static void sign(uint8_t *message, size_t n) {
    uint32_t sum =
        (uint32_t)crc32(crc32(0, message, 16), message + CAPTURE_WIRE_HEADER, (unsigned)(n - CAPTURE_WIRE_HEADER));
    for (int i = 0; i < 4; i++) {
        message[16 + i] = (uint8_t)(sum >> (8 * i));
    }
}

/* Hostile bytes with a right checksum: either refused, or a message that says the same again. */
static void test_hostile(void **state) {
    (void)state;
    unsigned refused = 0, taken = 0;
    for (int i = 0; i < SAMPLES; i++) {
        const capture_message m = sample(i);
        const size_t n = capture_message_write(&m, bytes, sizeof bytes);
        core_random r = core_random_create(7, (uint32_t)i, 0, 0);
        for (int round = 0; round < 4000; round++) {
            uint8_t *copy = malloc(n), again[4096];
            memcpy(copy, bytes, n);
            for (uint32_t k = core_random_below(&r, 4); n > CAPTURE_WIRE_HEADER && k < 4; k++) {
                static const uint8_t values[] = {0, 1, 0x7f, 0x80, 0xff, 0xf0};
                const size_t at = CAPTURE_WIRE_HEADER + core_random_below(&r, (uint32_t)(n - CAPTURE_WIRE_HEADER));
                copy[at] = values[core_random_below(&r, 6)];
            }
            sign(copy, n);
            capture_message back;
            size_t used = 0;
            const char *why = NULL;
            if (capture_message_parse(&back, copy, n, &used, &why) == CAPTURE_WIRE_OK) {
                assert_int_equal(capture_message_write(&back, again, sizeof again), n);
                assert_memory_equal(again, copy, n);
                taken++;
            } else {
                assert_true(why[0] != '\0');
                refused++;
            }
            free(copy);
        }
    }
    assert_true(taken > 1000 && refused > 1000);
}

/* A header that promises too much is refused before anything is waited for. */
static void test_bounds(void **state) {
    (void)state;
    for (int i = 0; i < SAMPLES; i++) {
        const capture_message m = sample(i);
        assert_int_not_equal(capture_message_write(&m, bytes, sizeof bytes), 0);
        capture_message back;
        size_t used = 0;
        const char *why = NULL;
        static const uint32_t lengths[] = {0xffffffffu, 0x80000000u, CAPTURE_WIRE_MESSAGE, CAPTURE_WIRE_CHUNK + 9};
        for (int k = 0; k < 4; k++) {
            memcpy(bytes + 12, &lengths[k], 4);
            assert_int_equal(capture_message_parse(&back, bytes, CAPTURE_WIRE_HEADER, &used, &why), CAPTURE_WIRE_BAD);
        }
    }
    /* One byte too many in a payload. */
    const capture_message bye = sample(SAMPLES - 1);
    const size_t n = capture_message_write(&bye, bytes, sizeof bytes);
    bytes[12] = 1;
    bytes[n] = 0;
    sign(bytes, n + 1);
    capture_message back;
    size_t used = 0;
    const char *why = NULL;
    assert_int_equal(capture_message_parse(&back, bytes, n + 1, &used, &why), CAPTURE_WIRE_BAD);
}

/* What must not be sent is not written. */
static void test_nonsense(void **state) {
    (void)state;
    capture_message m = sample(CAPTURE_WIRE_CAMERA - 1);
    double *const numbers[] = {&m.camera.black[2], &m.camera.matrix[1][8], &m.camera.calibration[0][0],
                               &m.camera.aperture, &m.camera.focus_nearest};
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        static const double wrong[] = {NAN, INFINITY, -INFINITY, 1e300, -1e300};
        const double right = *numbers[i];
        for (int k = 0; k < 5; k++) {
            *numbers[i] = wrong[k];
            assert_int_equal(capture_message_write(&m, bytes, sizeof bytes), 0);
        }
        *numbers[i] = right;
        assert_int_not_equal(capture_message_write(&m, bytes, sizeof bytes), 0);
    }
    uint32_t *const sizes[] = {&m.camera.width,        &m.camera.height,        &m.camera.left,    &m.camera.top,
                               &m.camera.active_width, &m.camera.active_height, &m.camera.iso_max, &m.camera.white};
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        const uint32_t right = *sizes[i];
        *sizes[i] = 0xfffffff0u;
        assert_int_equal(capture_message_write(&m, bytes, sizeof bytes), 0);
        *sizes[i] = right;
    }
    m.camera.black[3] = m.camera.white;
    assert_int_equal(capture_message_write(&m, bytes, sizeof bytes), 0);
    m = sample(CAPTURE_WIRE_ERROR - 1);
    strcpy(m.error.text, "\x1b[2J"); /* nothing that steers a terminal */
    assert_int_equal(capture_message_write(&m, bytes, sizeof bytes), 0);
    memset(m.error.text, 'a', sizeof m.error.text); /* not terminated */
    assert_int_equal(capture_message_write(&m, bytes, sizeof bytes), 0);
    m.type = (capture_wire_type)99;
    assert_int_equal(capture_message_write(&m, bytes, sizeof bytes), 0);
}

/* ---- the channel ---- */

static capture_channel *ends[2];

static int make_channels(void **state) {
    (void)state;
    int fds[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, fds) != 0) {
        return -1;
    }
    for (int i = 0; i < 2; i++) {
        ends[i] = calloc(1, sizeof *ends[i]);
        capture_channel_begin(ends[i], fds[i], 60);
    }
    return 0;
}

static int free_channels(void **state) {
    (void)state;
    for (int i = 0; i < 2; i++) {
        capture_channel_end(ends[i]);
        capture_channel_end(ends[i]);
        free(ends[i]);
    }
    return 0;
}

static void test_channel(void **state) {
    (void)state;
    capture_message back;
    for (int i = 0; i < SAMPLES; i++) {
        const capture_message m = sample(i);
        assert_int_equal(capture_channel_send(ends[0], &m), CAPTURE_CHANNEL_OK);
    }
    for (int i = 0; i < SAMPLES; i++) {
        assert_int_equal(capture_channel_receive(ends[1], &back, 1000), CAPTURE_CHANNEL_OK);
        assert_int_equal(back.type, i + 1);
        assert_int_equal(back.number, sample(i).number);
    }
    capture_message wrong = sample(0);
    wrong.hello.program[0] = '\n';
    assert_int_equal(capture_channel_send(ends[0], &wrong), CAPTURE_CHANNEL_BAD);
}

static void *drip(void *fd) {
    const capture_message m = sample(CAPTURE_WIRE_OPEN - 1);
    uint8_t message[256];
    const size_t n = capture_message_write(&m, message, sizeof message);
    for (size_t i = 0; i < n; i++) {
        if (write(*(int *)fd, message + i, 1) != 1) {
            break;
        }
        usleep(500);
    }
    return NULL;
}

static void test_channel_in_pieces(void **state) {
    (void)state;
    ends[1]->patience = 10000;
    pthread_t thread;
    capture_message back;
    assert_int_equal(pthread_create(&thread, NULL, drip, &ends[0]->fd), 0);
    assert_int_equal(capture_channel_receive(ends[1], &back, 10000), CAPTURE_CHANNEL_OK);
    assert_string_equal(back.open.id, "2");
    pthread_join(thread, NULL);
}

static bool stop(void *user) {
    return ++*(int *)user > 2;
}

static void test_channel_gives_up(void **state) {
    (void)state;
    const capture_message m = sample(CAPTURE_WIRE_CAMERA - 1);
    const size_t n = capture_message_write(&m, bytes, sizeof bytes);
    capture_message back;
    int asked = 0;
    assert_int_equal(capture_channel_receive(ends[1], &back, 20), CAPTURE_CHANNEL_TIMEOUT);
    ends[1]->stopped = stop;
    ends[1]->user = &asked;
    assert_int_equal(capture_channel_receive(ends[1], &back, 600000), CAPTURE_CHANNEL_STOPPED);
    ends[1]->stopped = NULL;
    /* A message that stops in the middle is waited for as long as `patience` says; its end is taken when it comes. */
    assert_int_equal(write(ends[0]->fd, bytes, n - 1), (int)n - 1);
    assert_int_equal(capture_channel_receive(ends[1], &back, 600000), CAPTURE_CHANNEL_TIMEOUT);
    assert_int_equal(write(ends[0]->fd, bytes + n - 1, 1), 1);
    assert_int_equal(capture_channel_receive(ends[1], &back, 1000), CAPTURE_CHANNEL_OK);
    /* A peer that does not read. */
    const capture_message data = sample(CAPTURE_WIRE_DATA - 1);
    capture_channel_result result = CAPTURE_CHANNEL_OK;
    for (int i = 0; i < 100000 && result == CAPTURE_CHANNEL_OK; i++) {
        result = capture_channel_send(ends[1], &data);
    }
    assert_int_equal(result, CAPTURE_CHANNEL_TIMEOUT);
    /* One that goes away in the middle. */
    assert_int_equal(write(ends[0]->fd, bytes, 30), 30);
    capture_channel_end(ends[0]);
    assert_int_equal(capture_channel_receive(ends[1], &back, 600000), CAPTURE_CHANNEL_CLOSED);
    assert_int_equal(capture_channel_send(ends[1], &m), CAPTURE_CHANNEL_CLOSED);
    assert_int_equal(capture_channel_receive(ends[0], &back, 600000), CAPTURE_CHANNEL_CLOSED);
    assert_int_equal(capture_channel_send(ends[0], &m), CAPTURE_CHANNEL_CLOSED);
}

static void test_channel_not_ours(void **state) {
    (void)state;
    capture_message back;
    assert_int_equal(write(ends[0]->fd, "HTTP/1.1 400 Bad Request\r\n", 26), 26);
    assert_int_equal(capture_channel_receive(ends[1], &back, 600000), CAPTURE_CHANNEL_BAD);
    assert_non_null(strstr(ends[1]->why, "does not speak"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_damage),
        cmocka_unit_test(test_hostile),
        cmocka_unit_test(test_bounds),
        cmocka_unit_test(test_nonsense),
        cmocka_unit_test_setup_teardown(test_channel, make_channels, free_channels),
        cmocka_unit_test_setup_teardown(test_channel_in_pieces, make_channels, free_channels),
        cmocka_unit_test_setup_teardown(test_channel_gives_up, make_channels, free_channels),
        cmocka_unit_test_setup_teardown(test_channel_not_ours, make_channels, free_channels),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
