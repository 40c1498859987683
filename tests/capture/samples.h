/* SPDX-License-Identifier: Apache-2.0 */
/*
 * samples.h: one sound message of every type.
 */
#ifndef TESTS_CAPTURE_SAMPLES_H
#define TESTS_CAPTURE_SAMPLES_H

#include <string.h>

#include "capture/protocol.h"

enum { SAMPLES = 11 };

/* Sample `index`, of type index + 1. */
static inline capture_message sample(int index) {
    static uint8_t bytes[300];
    capture_message m;
    memset(&m, 0, sizeof m); /* padding too: they are compared as bytes */
    m.type = (capture_wire_type)(index + 1);
    m.number = 0x01020304u + (uint32_t)index;
    switch (m.type) {
    case CAPTURE_WIRE_HELLO:
        strcpy(m.hello.program, "BRACE 1.2.3");
        break;
    case CAPTURE_WIRE_WELCOME:
        strcpy(m.welcome.make, "Google");
        strcpy(m.welcome.model, "Pixel 8");
        m.welcome.count = 2;
        strcpy(m.welcome.cameras[0].id, "0");
        m.welcome.cameras[0].facing = CAPTURE_WIRE_BACK;
        m.welcome.cameras[0].usable = true;
        m.welcome.cameras[0].focal_length = 6.9;
        strcpy(m.welcome.cameras[1].id, "1");
        break;
    case CAPTURE_WIRE_OPEN:
        strcpy(m.open.id, "2");
        break;
    case CAPTURE_WIRE_CAMERA:
        strcpy(m.camera.id, "0");
        m.camera.facing = CAPTURE_WIRE_BACK;
        m.camera.width = 4080;
        m.camera.height = 3072;
        m.camera.left = 8;
        m.camera.top = 12;
        m.camera.active_width = 4064;
        m.camera.active_height = 3048;
        m.camera.cfa = 2;
        m.camera.white = 1023;
        for (int i = 0; i < 4; i++) {
            m.camera.black[i] = 63.5 + i;
        }
        m.camera.exposure_min = 13000;
        m.camera.exposure_max = 16000000000;
        m.camera.frame_min = 33333333;
        m.camera.iso_min = 21;
        m.camera.iso_max = 10666;
        for (int i = 0; i < 18; i++) {
            m.camera.matrix[i / 9][i % 9] = (i - 7) / 16.0;
            m.camera.calibration[i / 9][i % 9] = i % 9 % 4 == 0 ? 1 : 0;
        }
        m.camera.illuminant[0] = 21;
        m.camera.illuminant[1] = 17;
        m.camera.orientation = 270;
        m.camera.aperture = 1.68;
        m.camera.focal_length = 6.9;
        m.camera.focus_nearest = 9.5;
        break;
    case CAPTURE_WIRE_METER:
        m.meter.focus = -1;
        m.meter.limit = 6000;
        break;
    case CAPTURE_WIRE_METERED:
        m.metered.exposure = 8333333;
        m.metered.iso = 125;
        m.metered.focus = 1.5;
        m.metered.neutral[0] = 0.49;
        m.metered.neutral[1] = 1;
        m.metered.neutral[2] = 0.61;
        m.metered.exposed = true;
        break;
    case CAPTURE_WIRE_SHOOT:
        m.shoot.exposure = 4166667;
        m.shoot.iso = 100;
        m.shoot.focus = 0;
        break;
    case CAPTURE_WIRE_FRAME:
        m.frame.width = 4080;
        m.frame.height = 3072;
        m.frame.exposure = 4166660;
        m.frame.iso = 100;
        m.frame.timestamp = 123456789012345;
        m.frame.clock = 1750000000123456789;
        m.frame.skew = 14500000;
        m.frame.neutral[0] = m.frame.neutral[1] = m.frame.neutral[2] = 1;
        m.frame.has_black = m.frame.has_noise = true;
        for (int i = 0; i < 4; i++) {
            m.frame.black[i] = 64.25;
            m.frame.noise[i][0] = 5e-5;
            m.frame.noise[i][1] = 2e-7;
        }
        m.frame.white = 1022;
        m.frame.focus = -1;
        break;
    case CAPTURE_WIRE_DATA:
        for (size_t i = 0; i < sizeof bytes; i++) {
            bytes[i] = (uint8_t)(7 * i);
        }
        m.data.offset = 1 << 18;
        m.data.size = sizeof bytes;
        m.data.bytes = bytes;
        break;
    case CAPTURE_WIRE_ERROR:
        m.error.trouble = CAPTURE_WIRE_BUSY;
        strcpy(m.error.text, "another app is using the camera");
        break;
    case CAPTURE_WIRE_BYE:
        break;
    }
    return m;
}

#endif
