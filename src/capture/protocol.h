/* SPDX-License-Identifier: Apache-2.0 */
/*
 * protocol.h: what the computer (camera_android.c) and the program on the phone
 * (android/) say to each other over the stream that adb forwards. C11 and libc
 * only: the NDK compiles these two files as they are.
 *
 * The computer asks, the phone answers, one request at a time:
 *
 *   HELLO -> WELCOME     who the phone is, which cameras it has
 *   OPEN  -> CAMERA      opens a camera; all that is constant about it
 *   METER -> METERED     exposure, focus and white balance found by the phone itself, once
 *   SHOOT -> FRAME, then DATA until width*height*2 bytes are there
 *   BYE                  no answer, both ends close
 *
 * ERROR may stand in place of any answer, and between two DATA.
 *
 * A message is a header of 20 bytes and a payload, all little-endian:
 *
 *   0  4  "BRCM"
 *   4  2  version, 1
 *   6  2  type
 *   8  4  number of the request; an answer repeats it
 *   12 4  length of the payload, bounded by the type
 *   16 4  CRC-32 (IEEE 802.3) of bytes 0 to 15 and the payload
 *
 * Numbers are integers or IEEE 754 doubles; texts a length byte and as many
 * bytes of printable ASCII. Every bound is checked before anything is waited for or kept.
 *
 * Thread safety: pure functions.
 */
#ifndef CAPTURE_PROTOCOL_H
#define CAPTURE_PROTOCOL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    CAPTURE_WIRE_VERSION = 1,
    CAPTURE_WIRE_HEADER = 20,
    CAPTURE_WIRE_CHUNK = 1 << 18, /* bytes of a mosaic in one DATA, at most */
    CAPTURE_WIRE_MESSAGE = CAPTURE_WIRE_HEADER + 8 + CAPTURE_WIRE_CHUNK, /* the longest message */
    CAPTURE_WIRE_CAMERAS = 16,
    CAPTURE_WIRE_SIDE = 32768,       /* pixels, at most */
    CAPTURE_WIRE_PORT = 7325,        /* of the computer's end, unless another is asked for */
};
#define CAPTURE_WIRE_PIXELS 400000000u /* of a mosaic, at most */
#define CAPTURE_WIRE_SOCKET "brace"    /* abstract socket on the phone */

typedef enum capture_wire_type {
    CAPTURE_WIRE_HELLO = 1,
    CAPTURE_WIRE_WELCOME,
    CAPTURE_WIRE_OPEN,
    CAPTURE_WIRE_CAMERA,
    CAPTURE_WIRE_METER,
    CAPTURE_WIRE_METERED,
    CAPTURE_WIRE_SHOOT,
    CAPTURE_WIRE_FRAME,
    CAPTURE_WIRE_DATA,
    CAPTURE_WIRE_ERROR,
    CAPTURE_WIRE_BYE
} capture_wire_type;

/* Why the phone could not do what it was asked to. */
typedef enum capture_wire_trouble {
    CAPTURE_WIRE_FAILED = 0,      /* asking again would not help */
    CAPTURE_WIRE_BUSY = 1,        /* another app has the camera, or it is not ready; nothing was exposed */
    CAPTURE_WIRE_DROPPED = 2,     /* exposed or not, the frame was lost */
    CAPTURE_WIRE_GONE = 3,        /* the camera was taken away or broke down: open it again */
    CAPTURE_WIRE_UNSUPPORTED = 4, /* no RAW or no manual exposure */
    CAPTURE_WIRE_REFUSED = 5      /* a value outside what the camera can do, or a message out of place */
} capture_wire_trouble;

typedef enum capture_wire_facing {
    CAPTURE_WIRE_FRONT = 0,
    CAPTURE_WIRE_BACK = 1,
    CAPTURE_WIRE_EXTERNAL = 2
} capture_wire_facing;

typedef struct capture_wire_hello {
    char program[64]; /* who asks: "BRACE 0.1.0" */
} capture_wire_hello;

typedef struct capture_wire_welcome {
    char make[64], model[64], system[64]; /* "Google", "Pixel 8", "Android 15" */
    uint32_t count;
    struct {
        char id[32]; /* Camera2's name of it: "0" */
        uint8_t facing;
        bool usable; /* RAW and manual exposure */
        double focal_length; /* millimetres; 0: unknown */
    } cameras[CAPTURE_WIRE_CAMERAS];
} capture_wire_welcome;

typedef struct capture_wire_open {
    char id[32]; /* "": the first camera on the back that is usable, else the first usable one */
} capture_wire_open;

/* Camera2's characteristics. Matrices are 0 throughout where the phone has none. */
typedef struct capture_wire_camera {
    char id[32];
    uint8_t facing;
    uint32_t width, height;                          /* of the RAW16 buffers */
    uint32_t left, top, active_width, active_height; /* SENSOR_INFO_PRE_CORRECTION_ACTIVE_ARRAY_SIZE, in the buffer */
    uint8_t cfa;                                     /* SENSOR_INFO_COLOR_FILTER_ARRANGEMENT: 0 RGGB ... 3 BGGR,
                                                      * of the buffer's first four pixels */
    uint32_t white;                                  /* SENSOR_INFO_WHITE_LEVEL */
    double black[4];                                 /* SENSOR_BLACK_LEVEL_PATTERN, rows of the buffer's first 2x2 */
    int64_t exposure_min, exposure_max;              /* nanoseconds */
    int64_t frame_min;                               /* nanoseconds from one RAW16 frame to the next, at least */
    uint32_t iso_min, iso_max;
    double matrix[2][9];      /* SENSOR_COLOR_TRANSFORM1, 2: XYZ to camera, as DNG ColorMatrix */
    double calibration[2][9]; /* SENSOR_CALIBRATION_TRANSFORM1, 2: as DNG CameraCalibration */
    uint8_t illuminant[2];    /* SENSOR_REFERENCE_ILLUMINANT1, 2: as EXIF LightSource; 0: none */
    uint16_t orientation;     /* SENSOR_ORIENTATION: 0, 90, 180, 270 degrees clockwise to upright */
    double aperture;          /* f-number; 0: unknown */
    double focal_length;      /* millimetres; 0: unknown */
    double focus_nearest;     /* LENS_INFO_MINIMUM_FOCUS_DISTANCE, dioptres; 0: a lens of fixed focus */
} capture_wire_camera;

typedef struct capture_wire_meter {
    double focus;   /* dioptres to focus at; < 0: find the focus too */
    uint32_t limit; /* milliseconds that it may take */
} capture_wire_meter;

typedef struct capture_wire_metered {
    int64_t exposure; /* nanoseconds that the phone would have chosen */
    uint32_t iso;
    double focus;      /* dioptres; < 0: unknown */
    double neutral[3]; /* SENSOR_NEUTRAL_COLOR_POINT; 0, 0, 0: unknown */
    bool focused, exposed, balanced; /* what had settled within the time */
} capture_wire_metered;

typedef struct capture_wire_shoot {
    int64_t exposure; /* nanoseconds */
    uint32_t iso;
    double focus; /* dioptres; < 0: where the lens was at the end of METER, or infinity */
} capture_wire_shoot;

/* Camera2's result of one frame. */
typedef struct capture_wire_frame {
    uint32_t width, height;
    int64_t exposure; /* SENSOR_EXPOSURE_TIME, nanoseconds */
    uint32_t iso;     /* SENSOR_SENSITIVITY */
    int64_t timestamp; /* SENSOR_TIMESTAMP: start of the first row's exposure, nanoseconds */
    int64_t clock;     /* the same in nanoseconds since 1970, UTC; 0: unknown */
    int64_t skew;      /* SENSOR_ROLLING_SHUTTER_SKEW, nanoseconds from the first row to past the last; 0: unknown */
    double neutral[3]; /* SENSOR_NEUTRAL_COLOR_POINT; 0, 0, 0: unknown */
    bool has_black;
    double black[4]; /* SENSOR_DYNAMIC_BLACK_LEVEL, as in capture_wire_camera */
    uint32_t white;  /* SENSOR_DYNAMIC_WHITE_LEVEL; 0: as in capture_wire_camera */
    bool has_noise;
    double noise[4][2]; /* SENSOR_NOISE_PROFILE: S and O at the four places of the filter array, row by row */
    double aperture, focal_length, focus; /* 0, 0, < 0: unknown */
} capture_wire_frame;

typedef struct capture_wire_data {
    uint32_t offset; /* in the mosaic without its stride, bytes */
    uint32_t size;   /* 1 to CAPTURE_WIRE_CHUNK */
    const uint8_t *bytes; /* after parsing: inside the message's own bytes */
} capture_wire_data;

typedef struct capture_wire_error {
    uint8_t trouble; /* capture_wire_trouble */
    char text[200];  /* a sentence */
} capture_wire_error;

typedef struct capture_message {
    capture_wire_type type;
    uint32_t number;
    union {
        capture_wire_hello hello;
        capture_wire_welcome welcome;
        capture_wire_open open;
        capture_wire_camera camera;
        capture_wire_meter meter;
        capture_wire_metered metered;
        capture_wire_shoot shoot;
        capture_wire_frame frame;
        capture_wire_data data;
        capture_wire_error error;
    };
} capture_message;

/* "HELLO", ...; "?" for none of them. */
const char *capture_wire_name(unsigned type);

typedef enum capture_wire_result {
    CAPTURE_WIRE_OK,   /* one message, *used bytes long */
    CAPTURE_WIRE_MORE, /* the beginning of one: *used bytes are needed at least, never more than CAPTURE_WIRE_MESSAGE */
    CAPTURE_WIRE_BAD   /* not one; *used is 0, *why says what is wrong */
} capture_wire_result;

/* Reads the message that `bytes` begin with. *out is complete after CAPTURE_WIRE_OK only. */
capture_wire_result capture_message_parse(capture_message *out, const uint8_t *bytes, size_t size, size_t *used,
                                          const char **why);

/* Writes a message; its length, or 0 when it does not fit or holds a value that parsing would refuse. */
size_t capture_message_write(const capture_message *message, uint8_t *bytes, size_t capacity);

#endif
