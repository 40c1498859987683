/* SPDX-License-Identifier: Apache-2.0 */
/* label.h: text on 8-bit RGB pictures: sheets and plots. */
#ifndef IMAGE_LABEL_H
#define IMAGE_LABEL_H

#include "brace/image.h"

/* Pixels that a text takes: 12 a character and 6 of margin, 20 high. */
enum { IMAGE_LABEL_HEIGHT = 20 };
uint32_t image_label_width(const char *text);

/* Text at (x, y), its top left corner, twice as large as the 5x7 font, on a dark ground so that it reads on any picture.
 * Digits, lower-case letters and some others; what the font lacks stays blank, what lies outside is cut off. */
void image_label(brace_image *image, uint32_t x, uint32_t y, const char *text, const uint8_t color[3]);

#endif
