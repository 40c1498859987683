/* SPDX-License-Identifier: Apache-2.0 */
/*
 * protocol.c: messages to bytes and back. The fields of each message are listed
 * once, in a function that both directions run, so that they cannot drift apart.
 */
#include "protocol.h"

#include <math.h>
#include <string.h>

static const uint8_t magic[4] = {'B', 'R', 'C', 'M'};

/* ---- fields ---- */

/* A place in a payload, which is read if `in` is set, else written to `out`. */
typedef struct cursor {
    const uint8_t *in;
    uint8_t *out;
    size_t at, size;
    bool ok;
} cursor;

/* Whether n more bytes fit; passes over them. */
static bool take(cursor *c, size_t n, size_t *at) {
    if (!c->ok || n > c->size - c->at) {
        c->ok = false;
        return false;
    }
    *at = c->at;
    c->at += n;
    return true;
}

static uint64_t get_little(const uint8_t *bytes, unsigned n) {
    uint64_t v = 0;
    for (unsigned i = n; i-- > 0;) {
        v = v << 8 | bytes[i];
    }
    return v;
}

static void put_little(uint8_t *bytes, unsigned n, uint64_t v) {
    for (unsigned i = 0; i < n; i++) {
        bytes[i] = (uint8_t)(v >> (8 * i));
    }
}

static uint64_t field(cursor *c, unsigned n, uint64_t v) {
    size_t at = 0;
    if (!take(c, n, &at)) {
        return 0;
    }
    if (c->in != NULL) {
        return get_little(c->in + at, n);
    }
    put_little(c->out + at, n, v);
    return v;
}

static void field_u8(cursor *c, uint8_t *v) {
    *v = (uint8_t)field(c, 1, *v);
}

static void field_u16(cursor *c, uint16_t *v) {
    *v = (uint16_t)field(c, 2, *v);
}

static void field_u32(cursor *c, uint32_t *v) {
    *v = (uint32_t)field(c, 4, *v);
}

static void field_i64(cursor *c, int64_t *v) {
    *v = (int64_t)field(c, 8, (uint64_t)*v);
}

static void field_bool(cursor *c, bool *v) {
    const uint64_t n = field(c, 1, *v ? 1 : 0);
    *v = n == 1;
    c->ok = c->ok && n <= 1;
}

static void field_f64(cursor *c, double *v, size_t count) {
    for (size_t i = 0; i < count; i++) {
        uint64_t bits = 0;
        memcpy(&bits, v + i, sizeof bits);
        bits = field(c, 8, bits);
        memcpy(v + i, &bits, sizeof bits);
        c->ok = c->ok && isfinite(v[i]);
    }
}

/* Printable ASCII: such a text can be shown on a terminal and put into EXIF as it is. */
static bool printable(const char *text, size_t n) {
    for (size_t i = 0; i < n; i++) {
        if (text[i] < ' ' || text[i] > '~') {
            return false;
        }
    }
    return true;
}

static void field_text(cursor *c, char *text, size_t capacity) {
    size_t n = c->in != NULL ? 0 : strnlen(text, capacity), at = 0;
    n = (size_t)field(c, 1, n);
    if (n >= capacity || n > 255 || !take(c, n, &at)) {
        c->ok = false;
        return;
    }
    if (c->in != NULL) {
        memcpy(text, c->in + at, n);
        text[n] = '\0';
    } else {
        memcpy(c->out + at, text, n);
    }
    c->ok = c->ok && printable(text, n);
}

/* ---- what each message holds, and what it may hold ---- */

static bool within(double v, double low, double high) {
    return v >= low && v <= high;
}

static bool duration(int64_t ns, int64_t least) {
    return ns >= least && ns <= 1000000000000; /* 1000 s */
}

static bool levels(const double black[4], uint32_t white) {
    bool ok = white >= 1 && white <= 65535;
    for (int i = 0; i < 4; i++) {
        ok = ok && within(black[i], 0, 65535) && black[i] < white;
    }
    return ok;
}

static bool neutral(const double v[3]) {
    if (v[0] == 0 && v[1] == 0 && v[2] == 0) {
        return true;
    }
    return within(v[0], 1e-3, 1e3) && within(v[1], 1e-3, 1e3) && within(v[2], 1e-3, 1e3);
}

static bool small_entries(const double *matrix, size_t count) {
    for (size_t i = 0; i < count; i++) {
        if (!within(matrix[i], -1000, 1000)) {
            return false;
        }
    }
    return true;
}

static bool mosaic_size(uint32_t width, uint32_t height) {
    return width >= 4 && height >= 4 && width <= CAPTURE_WIRE_SIDE && height <= CAPTURE_WIRE_SIDE &&
           (uint64_t)width * height <= CAPTURE_WIRE_PIXELS;
}

static void fields_welcome(cursor *c, capture_wire_welcome *m) {
    field_text(c, m->make, sizeof m->make);
    field_text(c, m->model, sizeof m->model);
    field_text(c, m->system, sizeof m->system);
    field_u32(c, &m->count);
    c->ok = c->ok && m->count <= CAPTURE_WIRE_CAMERAS;
    for (uint32_t i = 0; c->ok && i < m->count; i++) {
        field_text(c, m->cameras[i].id, sizeof m->cameras[i].id);
        field_u8(c, &m->cameras[i].facing);
        field_bool(c, &m->cameras[i].usable);
        field_f64(c, &m->cameras[i].focal_length, 1);
        c->ok = c->ok && m->cameras[i].facing <= CAPTURE_WIRE_EXTERNAL && within(m->cameras[i].focal_length, 0, 1e4);
    }
}

static void fields_camera(cursor *c, capture_wire_camera *m) {
    field_text(c, m->id, sizeof m->id);
    field_u8(c, &m->facing);
    field_u32(c, &m->width);
    field_u32(c, &m->height);
    field_u32(c, &m->left);
    field_u32(c, &m->top);
    field_u32(c, &m->active_width);
    field_u32(c, &m->active_height);
    field_u8(c, &m->cfa);
    field_u32(c, &m->white);
    field_f64(c, m->black, 4);
    field_i64(c, &m->exposure_min);
    field_i64(c, &m->exposure_max);
    field_i64(c, &m->frame_min);
    field_u32(c, &m->iso_min);
    field_u32(c, &m->iso_max);
    field_f64(c, m->matrix[0], 18);
    field_f64(c, m->calibration[0], 18);
    field_u8(c, &m->illuminant[0]);
    field_u8(c, &m->illuminant[1]);
    field_u16(c, &m->orientation);
    field_f64(c, &m->aperture, 1);
    field_f64(c, &m->focal_length, 1);
    field_f64(c, &m->focus_nearest, 1);
    c->ok = c->ok && m->facing <= CAPTURE_WIRE_EXTERNAL && mosaic_size(m->width, m->height) && m->cfa <= 3 &&
            m->active_width >= 4 && m->active_height >= 4 && m->left < m->width && m->top < m->height &&
            m->active_width <= m->width - m->left && m->active_height <= m->height - m->top &&
            levels(m->black, m->white) && duration(m->exposure_min, 1) && duration(m->exposure_max, m->exposure_min) &&
            duration(m->frame_min, 0) && m->iso_min >= 1 && m->iso_max >= m->iso_min && m->iso_max <= 10000000 &&
            small_entries(m->matrix[0], 18) && small_entries(m->calibration[0], 18) && m->orientation % 90 == 0 &&
            m->orientation < 360 && within(m->aperture, 0, 1e3) && within(m->focal_length, 0, 1e4) &&
            within(m->focus_nearest, 0, 1e4);
}

static void fields_metered(cursor *c, capture_wire_metered *m) {
    field_i64(c, &m->exposure);
    field_u32(c, &m->iso);
    field_f64(c, &m->focus, 1);
    field_f64(c, m->neutral, 3);
    field_bool(c, &m->focused);
    field_bool(c, &m->exposed);
    field_bool(c, &m->balanced);
    c->ok = c->ok && duration(m->exposure, 0) && within(m->focus, -1, 1e4) && neutral(m->neutral);
}

static void fields_frame(cursor *c, capture_wire_frame *m) {
    field_u32(c, &m->width);
    field_u32(c, &m->height);
    field_i64(c, &m->exposure);
    field_u32(c, &m->iso);
    field_i64(c, &m->timestamp);
    field_i64(c, &m->clock);
    field_i64(c, &m->skew);
    field_f64(c, m->neutral, 3);
    field_bool(c, &m->has_black);
    field_f64(c, m->black, 4);
    field_u32(c, &m->white);
    field_bool(c, &m->has_noise);
    field_f64(c, m->noise[0], 8);
    field_f64(c, &m->aperture, 1);
    field_f64(c, &m->focal_length, 1);
    field_f64(c, &m->focus, 1);
    c->ok = c->ok && mosaic_size(m->width, m->height) && duration(m->exposure, 1) && m->iso >= 1 &&
            m->iso <= 10000000 && m->timestamp >= 0 && m->clock >= 0 && duration(m->skew, 0) && neutral(m->neutral) &&
            m->white <= 65535 && (!m->has_black || levels(m->black, m->white != 0 ? m->white : 65535)) &&
            within(m->aperture, 0, 1e3) && within(m->focal_length, 0, 1e4) && within(m->focus, -1, 1e4);
    for (int i = 0; i < 4; i++) {
        c->ok = c->ok && within(m->noise[i][0], 0, 1) && within(m->noise[i][1], 0, 1);
    }
}

static void fields_data(cursor *c, capture_wire_data *m) {
    size_t at = 0;
    field_u32(c, &m->offset);
    field_u32(c, &m->size);
    if (m->size == 0 || m->size > CAPTURE_WIRE_CHUNK || !take(c, m->size, &at)) {
        c->ok = false;
        return;
    }
    if (c->in != NULL) {
        m->bytes = c->in + at;
    } else {
        memcpy(c->out + at, m->bytes, m->size);
    }
}

static void fields(cursor *c, capture_message *m) {
    switch (m->type) {
    case CAPTURE_WIRE_HELLO:
        field_text(c, m->hello.program, sizeof m->hello.program);
        break;
    case CAPTURE_WIRE_WELCOME:
        fields_welcome(c, &m->welcome);
        break;
    case CAPTURE_WIRE_OPEN:
        field_text(c, m->open.id, sizeof m->open.id);
        break;
    case CAPTURE_WIRE_CAMERA:
        fields_camera(c, &m->camera);
        break;
    case CAPTURE_WIRE_METER:
        field_f64(c, &m->meter.focus, 1);
        field_u32(c, &m->meter.limit);
        c->ok = c->ok && within(m->meter.focus, -1, 1e4) && m->meter.limit >= 1 && m->meter.limit <= 60000;
        break;
    case CAPTURE_WIRE_METERED:
        fields_metered(c, &m->metered);
        break;
    case CAPTURE_WIRE_SHOOT:
        field_i64(c, &m->shoot.exposure);
        field_u32(c, &m->shoot.iso);
        field_f64(c, &m->shoot.focus, 1);
        c->ok = c->ok && duration(m->shoot.exposure, 1) && m->shoot.iso >= 1 && m->shoot.iso <= 10000000 &&
                within(m->shoot.focus, -1, 1e4);
        break;
    case CAPTURE_WIRE_FRAME:
        fields_frame(c, &m->frame);
        break;
    case CAPTURE_WIRE_DATA:
        fields_data(c, &m->data);
        break;
    case CAPTURE_WIRE_ERROR:
        field_u8(c, &m->error.trouble);
        field_text(c, m->error.text, sizeof m->error.text);
        c->ok = c->ok && m->error.trouble <= CAPTURE_WIRE_REFUSED;
        break;
    case CAPTURE_WIRE_BYE:
        break;
    default:
        c->ok = false;
    }
}

/* ---- messages ---- */

const char *capture_wire_name(unsigned type) {
    static const char *const names[] = {"?",       "HELLO", "WELCOME", "OPEN", "CAMERA", "METER",
                                        "METERED", "SHOOT", "FRAME",   "DATA", "ERROR",  "BYE"};
    return type < sizeof names / sizeof names[0] ? names[type] : names[0];
}

/* CRC-32 of IEEE 802.3, bits reflected. The table costs less than a percent of a DATA's bytes. */
static uint32_t crc(const uint8_t *header, const uint8_t *payload, size_t length) {
    uint32_t table[256];
    for (uint32_t i = 0; i < 256; i++) {
        uint32_t v = i;
        for (int k = 0; k < 8; k++) {
            v = (v & 1) != 0 ? v >> 1 ^ 0xedb88320u : v >> 1;
        }
        table[i] = v;
    }
    uint32_t sum = 0xffffffffu;
    for (size_t i = 0; i < 16; i++) {
        sum = table[(sum ^ header[i]) & 255] ^ sum >> 8;
    }
    for (size_t i = 0; i < length; i++) {
        sum = table[(sum ^ payload[i]) & 255] ^ sum >> 8;
    }
    return ~sum;
}

/* The longest payload of a type, so that a header that promises more is not waited for. */
static size_t longest(unsigned type) {
    return type == CAPTURE_WIRE_DATA ? 8 + CAPTURE_WIRE_CHUNK : 2048;
}

static capture_wire_result bad(const char **why, const char *text) {
    *why = text;
    return CAPTURE_WIRE_BAD;
}

capture_wire_result capture_message_parse(capture_message *out, const uint8_t *bytes, size_t size, size_t *used,
                                          const char **why) {
    *used = 0;
    *why = "";
    if (memcmp(bytes, magic, size < sizeof magic ? size : sizeof magic) != 0) {
        return bad(why, "it does not speak this protocol");
    }
    if (size < CAPTURE_WIRE_HEADER) {
        *used = CAPTURE_WIRE_HEADER;
        return CAPTURE_WIRE_MORE;
    }
    if (get_little(bytes + 4, 2) != CAPTURE_WIRE_VERSION) {
        return bad(why, "it speaks another version of the protocol; use programs of one release at both ends");
    }
    const unsigned type = (unsigned)get_little(bytes + 6, 2);
    const size_t length = (size_t)get_little(bytes + 12, 4);
    if (type < CAPTURE_WIRE_HELLO || type > CAPTURE_WIRE_BYE) {
        return bad(why, "a message of no known type");
    }
    if (length > longest(type)) {
        return bad(why, "a message longer than its type may be");
    }
    if (size < CAPTURE_WIRE_HEADER + length) {
        *used = CAPTURE_WIRE_HEADER + length;
        return CAPTURE_WIRE_MORE;
    }
    if (get_little(bytes + 16, 4) != crc(bytes, bytes + CAPTURE_WIRE_HEADER, length)) {
        return bad(why, "a message that was damaged on its way (checksum)");
    }
    memset(out, 0, sizeof *out);
    out->type = (capture_wire_type)type;
    out->number = (uint32_t)get_little(bytes + 8, 4);
    cursor c = {.in = bytes + CAPTURE_WIRE_HEADER, .size = length, .ok = true};
    fields(&c, out);
    if (!c.ok || c.at != length) {
        return bad(why, "a message with a value that makes no sense");
    }
    *used = CAPTURE_WIRE_HEADER + length;
    return CAPTURE_WIRE_OK;
}

size_t capture_message_write(const capture_message *message, uint8_t *bytes, size_t capacity) {
    if (capacity < CAPTURE_WIRE_HEADER) {
        return 0;
    }
    capture_message copy = *message; /* the fields are visited by writable pointer */
    const size_t room = capacity - CAPTURE_WIRE_HEADER, most = longest(message->type);
    cursor c = {.out = bytes + CAPTURE_WIRE_HEADER, .size = room < most ? room : most, .ok = true};
    fields(&c, &copy);
    if (!c.ok) {
        return 0;
    }
    memcpy(bytes, magic, sizeof magic);
    put_little(bytes + 4, 2, CAPTURE_WIRE_VERSION);
    put_little(bytes + 6, 2, (uint64_t)message->type);
    put_little(bytes + 8, 4, message->number);
    put_little(bytes + 12, 4, c.at);
    put_little(bytes + 16, 4, crc(bytes, bytes + CAPTURE_WIRE_HEADER, c.at));
    return CAPTURE_WIRE_HEADER + c.at;
}
