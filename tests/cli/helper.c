/* SPDX-License-Identifier: Apache-2.0 */
/*
 * helper.c: what the command line tests need and a shell can't do:
 *   edit IN OUT KEY=VALUE...    a DNG changed: crop=X,Y,W,H time=S iso=N model=M
 *                               orientation=N flat=VALUE white=N
 *   json FILE KEY...            the value at the path of keys and indices
 *   mean FILE.ppm               the mean of each channel, 0 to 1
 *   size FILE                   width, height, channels, bits of a picture
 *   same A B LIMIT              whether two pictures differ by at most LIMIT of 255 in the mean
 *   damage IN OUT SEED          flips some bits
 *   network OUT.safetensors NAME [VALUE]  random weights of the small network NAME (brace-s, tmrnet-s), such as brace
 *                               train would write; VALUE instead of the first of them
 *   white FILE.png SIDE         a square picture of one colour, in one bit a pixel
 *   stop MILLISECONDS SIGNAL[,SIGNAL...] COMMAND...  runs a command, sends signals, 20 ms
 *                               apart, and prints its exit code (128 + N for signal N)
 */
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <jansson.h>
#include <zlib.h>

#include "brace/brace.h"
#include "core/core.h"
#include "models/models.h"

static int fail(const char *what) {
    fprintf(stderr, "helper: %s\n", what);
    return 1;
}

/* ---- edit ---- */

static brace_frame *cropped(const brace_frame *f, unsigned x, unsigned y, unsigned w, unsigned h) {
    brace_frame *out = NULL;
    brace_error error;
    if (x + w > f->width || y + h > f->height || brace_frame_create(&out, w, h, f->cfa, &error) != BRACE_OK) {
        return NULL;
    }
    /* The clone brings the tags; its pixels are replaced by the smaller frame's. */
    brace_frame *clone = NULL;
    if (brace_frame_clone(&clone, f, &error) != BRACE_OK) {
        brace_frame_destroy(out);
        return NULL;
    }
    for (unsigned r = 0; r < h; r++) {
        memcpy(out->data + (size_t)r * w, f->data + (size_t)(y + r) * f->width + x, w * sizeof *out->data);
    }
    uint16_t *data = out->data;
    out->data = clone->data;
    clone->data = data;
    clone->width = w;
    clone->height = h;
    for (unsigned i = 0; i < 4; i++) {
        clone->black[i] = f->black[((i >> 1 ^ y) & 1) * 2 + ((i ^ x) & 1)];
    }
    clone->cfa = (brace_cfa)((unsigned)f->cfa ^ (x & 1) ^ (y & 1) << 1); /* the enum's bits are the shifts */
    brace_frame_destroy(out);
    return clone;
}

static int edit(int argc, char **argv) {
    brace_frame *f = NULL;
    brace_error error = {0};
    if (argc < 2 || brace_frame_read(&f, argv[0], NULL, &error) != BRACE_OK) {
        return fail(error.message);
    }
    for (int i = 2; i < argc; i++) {
        unsigned x, y, w, h;
        const char *value = strchr(argv[i], '=');
        if (value == NULL) {
            return fail("KEY=VALUE expected");
        }
        value++;
        if (sscanf(argv[i], "crop=%u,%u,%u,%u", &x, &y, &w, &h) == 4) {
            brace_frame *smaller = cropped(f, x, y, w, h);
            brace_frame_destroy(f);
            f = smaller;
            if (f == NULL) {
                return fail("crop failed");
            }
        } else if (strncmp(argv[i], "time=", 5) == 0) {
            f->exposure_time = atof(value);
        } else if (strncmp(argv[i], "iso=", 4) == 0) {
            f->iso = atof(value);
        } else if (strncmp(argv[i], "orientation=", 12) == 0) {
            f->orientation = atoi(value);
        } else if (strncmp(argv[i], "white=", 6) == 0) {
            f->white = (float)atof(value);
        } else if (strncmp(argv[i], "model=", 6) == 0) {
            snprintf(f->model, sizeof f->model, "%s", value);
            snprintf(f->unique_model, sizeof f->unique_model, "%s", value);
        } else if (strncmp(argv[i], "flat=", 5) == 0) {
            for (size_t p = 0; p < (size_t)f->width * f->height; p++) {
                f->data[p] = (uint16_t)atoi(value);
            }
        } else {
            return fail("unknown key");
        }
    }
    brace_status status = brace_frame_write_dng(f, argv[1], NULL, NULL, &error);
    brace_frame_destroy(f);
    return status == BRACE_OK ? 0 : fail(error.message);
}

static int damage(int argc, char **argv) {
    void *data = NULL;
    size_t size = 0;
    brace_error error = {0};
    if (argc != 3 || core_file_load(&data, &size, argv[0], 1u << 28, &error) != BRACE_OK) {
        return fail(error.message);
    }
    core_random r = core_random_create((uint64_t)atol(argv[2]), 1, 2, 3);
    unsigned char *bytes = data;
    for (int i = 0; i < 40; i++) { /* half of them in the tags at the beginning */
        size_t span = i % 2 == 0 && size > 1024 ? 1024 : size;
        bytes[core_random_below(&r, (uint32_t)span)] ^= (unsigned char)(1u << core_random_below(&r, 8));
    }
    FILE *to = fopen(argv[1], "wb");
    int code = to != NULL && fwrite(data, 1, size, to) == size ? 0 : 1;
    code |= to == NULL || fclose(to) != 0;
    core_free(data);
    return code;
}

/* ---- json ---- */

static int json(int argc, char **argv) {
    json_error_t error;
    json_t *root = argc >= 1 ? json_load_file(argv[0], JSON_REJECT_DUPLICATES, &error) : NULL;
    const json_t *at = root;
    if (root == NULL) {
        return fail(argc >= 1 ? error.text : "file expected");
    }
    for (int i = 1; i < argc && at != NULL; i++) {
        if (json_is_array(at) && strcmp(argv[i], "count") == 0) {
            printf("%zu\n", json_array_size(at));
            json_decref(root);
            return 0;
        }
        at = json_is_array(at) ? json_array_get(at, (size_t)atoi(argv[i])) : json_object_get(at, argv[i]);
    }
    int code = 0;
    if (at == NULL) {
        code = fail("no such key");
    } else if (json_is_string(at)) {
        printf("%s\n", json_string_value(at));
    } else if (json_is_number(at)) {
        printf("%g\n", json_number_value(at));
    } else {
        static const char *const names[] = {"object", "array", "string", "integer", "real", "true", "false", "null"};
        printf("%s\n", names[json_typeof(at)]);
    }
    json_decref(root);
    return code;
}

/* ---- pictures ---- */

static int mean(const char *path) {
    unsigned width, height, most;
    FILE *f = fopen(path, "rb");
    if (f == NULL || fscanf(f, "P6 %u %u %u", &width, &height, &most) != 3 || fgetc(f) == EOF) {
        return fail("no PPM file");
    }
    double sum[3] = {0, 0, 0};
    size_t pixels = (size_t)width * height;
    for (size_t i = 0; i < pixels * 3; i++) {
        int value = fgetc(f);
        value = most > 255 ? value << 8 | fgetc(f) : value;
        if (feof(f)) {
            fclose(f);
            return fail("the PPM file is too short");
        }
        sum[i % 3] += value;
    }
    fclose(f);
    for (int c = 0; c < 3; c++) {
        printf("%.6f%s", sum[c] / (double)pixels / most, c < 2 ? " " : "\n");
    }
    return 0;
}

static int size(const char *path) {
    static const int bits[] = {8, 16, 32};
    brace_image *image = NULL;
    brace_error error = {0};
    if (brace_image_read(&image, path, NULL, &error) != BRACE_OK) {
        return fail(error.message);
    }
    printf("%u %u %u %d\n", image->width, image->height, image->channels, bits[image->sample]);
    brace_image_destroy(image);
    return 0;
}

static int same(const char *a, const char *b, double limit) {
    brace_image *read[2] = {NULL, NULL}, *image[2] = {NULL, NULL};
    brace_error error = {0};
    const char *paths[2] = {a, b};
    for (int i = 0; i < 2; i++) {
        if (brace_image_read(&read[i], paths[i], NULL, &error) != BRACE_OK ||
            brace_image_convert(&image[i], read[i], 3, BRACE_SAMPLE_U8, BRACE_TRANSFER_SRGB, &error) != BRACE_OK) {
            return fail(error.message);
        }
        brace_image_destroy(read[i]);
    }
    if (image[0]->width != image[1]->width || image[0]->height != image[1]->height) {
        return fail("the pictures differ in size");
    }
    double sum = 0;
    for (uint32_t y = 0; y < image[0]->height; y++) {
        const uint8_t *p = (const uint8_t *)image[0]->data + y * image[0]->stride;
        const uint8_t *q = (const uint8_t *)image[1]->data + y * image[1]->stride;
        for (uint32_t x = 0; x < image[0]->width * 3; x++) {
            sum += abs(p[x] - q[x]);
        }
    }
    sum /= 3.0 * image[0]->width * image[0]->height;
    brace_image_destroy(image[0]);
    brace_image_destroy(image[1]);
    printf("%.4f\n", sum);
    return sum <= limit ? 0 : 1;
}

/* ---- white ---- */

static void put_chunk(FILE *f, const char *type, const unsigned char *data, size_t size) {
    unsigned char word[4];
    uLong crc = crc32(crc32(0, (const unsigned char *)type, 4), data, (uInt)size);
    for (int k = 0; k < 2; k++) {
        const size_t value = k == 0 ? size : crc;
        for (int i = 0; i < 4; i++) {
            word[i] = (unsigned char)(value >> (24 - 8 * i));
        }
        fwrite(word, 1, 4, f);
        if (k == 0) {
            fwrite(type, 1, 4, f);
            fwrite(data, 1, size, f);
        }
    }
}

static int white(const char *path, unsigned side) {
    const size_t row = 1 + (side + 7) / 8; /* the row's filter, then its pixels */
    unsigned char *rows = malloc(row * side);
    uLongf size = compressBound((uLong)(row * side));
    unsigned char *packed = malloc(size);
    FILE *f = fopen(path, "wb");
    if (rows == NULL || packed == NULL || f == NULL) {
        return fail("no memory or no file");
    }
    memset(rows, 0xff, row * side);
    for (size_t y = 0; y < side; y++) {
        rows[y * row] = 0;
    }
    compress2(packed, &size, rows, (uLong)(row * side), 1);
    unsigned char header[13] = {0, 0, 0, 0, 0, 0, 0, 0, 1};
    for (int i = 0; i < 4; i++) {
        header[i] = header[4 + i] = (unsigned char)(side >> (24 - 8 * i));
    }
    fwrite("\x89PNG\r\n\x1a\n", 1, 8, f);
    put_chunk(f, "IHDR", header, sizeof header);
    put_chunk(f, "IDAT", packed, size);
    put_chunk(f, "IEND", header, 0);
    free(rows);
    free(packed);
    return fclose(f) == 0 ? 0 : fail("cannot write");
}

/* ---- network ---- */

static int network(int argc, char **argv) {
    brace_error error = {0};
    models_shape shape;
    nn_weights *weights = NULL;
    nn_graph *g = NULL;
    if (argc < 2 || !models_shape_named(&shape, argv[1])) {
        return fail("network OUT.safetensors NAME [VALUE]");
    }
    shape.channels = 8, shape.global = 1, shape.reconstruct = 0;
    brace_status status = nn_weights_create(&weights, 1, &error);
    if (status == BRACE_OK) {
        status = nn_graph_create(&g, weights, NULL, &error);
    }
    if (status == BRACE_OK) {
        const models_inputs inputs = models_inputs_create(g, models_views(&shape), 64, 64);
        models_build(g, &shape, &inputs);
        status = nn_graph_error(g, &error);
    }
    json_t *json = models_shape_json(&shape);
    char *text = json_dumps(json, JSON_COMPACT);
    if (status == BRACE_OK) {
        nn_parameter *last = nn_weights_find(weights, "conv_last.weight");
        core_random r = core_random_create(1, 0, 0, 0);
        for (size_t i = 0; i < last->count; i++) {
            last->value[i] = (float)(0.005 * core_random_normal(&r));
        }
        if (argc > 2) {
            nn_weights_at(weights, 0)->value[0] = (float)atof(argv[2]);
        }
        const char *metadata[] = {"model", argv[1], "network", text, NULL};
        status = nn_weights_save(weights, argv[0], "bf16", metadata, &error);
    }
    free(text);
    json_decref(json);
    nn_graph_destroy(g);
    nn_weights_destroy(weights);
    return status == BRACE_OK ? 0 : fail(error.message);
}

/* ---- stop ---- */

static void wait_ms(long ms) {
    struct timespec t = {ms / 1000, ms % 1000 * 1000000};
    while (nanosleep(&t, &t) != 0 && errno == EINTR) {
    }
}

/* "FILE+200": 200 ms after the file is there, however fast the machine; "200": after the start. */
static void wait_until(const char *when) {
    const char *plus = strrchr(when, '+');
    if (plus != NULL) {
        char *file = strndup(when, (size_t)(plus - when));
        for (int i = 0; i < 6000 && file != NULL && access(file, F_OK) != 0; i++) {
            wait_ms(10);
        }
        free(file);
    }
    wait_ms(atol(plus != NULL ? plus + 1 : when));
}

static int stop(int argc, char **argv) {
    if (argc < 3) {
        return fail("stop [FILE+]MILLISECONDS SIGNALS COMMAND...");
    }
    pid_t child = fork();
    if (child == 0) {
        signal(SIGINT, SIG_DFL); /* shells start background jobs with it ignored */
        execvp(argv[2], argv + 2);
        _exit(127);
    }
    wait_until(argv[0]);
    for (char *word = strtok(argv[1], ","); word != NULL; word = strtok(NULL, ",")) {
        int number = strcmp(word, "INT") == 0 ? SIGINT : strcmp(word, "TERM") == 0 ? SIGTERM : SIGHUP;
        kill(child, number);
        wait_ms(20);
    }
    int status = 0;
    waitpid(child, &status, 0);
    printf("%d\n", WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status));
    return 0;
}

int main(int argc, char **argv) {
    const char *name = argc > 1 ? argv[1] : "";
    argc -= 2;
    argv += 2;
    if (strcmp(name, "edit") == 0) {
        return edit(argc, argv);
    }
    if (strcmp(name, "damage") == 0) {
        return damage(argc, argv);
    }
    if (strcmp(name, "json") == 0) {
        return json(argc, argv);
    }
    if (strcmp(name, "mean") == 0 && argc == 1) {
        return mean(argv[0]);
    }
    if (strcmp(name, "size") == 0 && argc == 1) {
        return size(argv[0]);
    }
    if (strcmp(name, "same") == 0 && argc == 3) {
        return same(argv[0], argv[1], atof(argv[2]));
    }
    if (strcmp(name, "white") == 0 && argc == 2) {
        return white(argv[0], (unsigned)atol(argv[1]));
    }
    if (strcmp(name, "network") == 0) {
        return network(argc, argv);
    }
    if (strcmp(name, "stop") == 0) {
        return stop(argc, argv);
    }
    return fail("edit, damage, json, mean, size, same, network, white or stop");
}
