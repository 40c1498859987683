/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pickle.c: the stack machine. The instructions are those of Python's pickletools,
 * protocols 2 to 5. Values and items are counted, which bounds memory and time:
 * nothing here walks what a value contains but to make as many items.
 */
#include "nn/pickle.h"

#include <string.h>

/* ---- the names that are known ---- */

typedef enum name_kind {
    NAME_DICT,      /* collections.OrderedDict(items) */
    NAME_TENSOR,    /* _rebuild_tensor(storage, offset, shape, stride), _v2 with more */
    NAME_PARAMETER, /* _rebuild_parameter(tensor, ...) */
    NAME_SIZE,      /* torch.Size(tuple) */
    NAME_STORAGE    /* a type of numbers */
} name_kind;

static const struct {
    const char *module, *name;
    name_kind kind;
    core_dtype dtype;
} names[] = {
    {"collections", "OrderedDict", NAME_DICT, 0},
    {"torch._utils", "_rebuild_tensor", NAME_TENSOR, 0},
    {"torch._utils", "_rebuild_tensor_v2", NAME_TENSOR, 0},
    {"torch._utils", "_rebuild_parameter", NAME_PARAMETER, 0},
    {"torch.nn.parameter", "_rebuild_parameter", NAME_PARAMETER, 0},
    {"torch.nn.parameter", "Parameter", NAME_PARAMETER, 0},
    {"torch", "Size", NAME_SIZE, 0},
    {"torch", "FloatStorage", NAME_STORAGE, CORE_F32},
    {"torch", "DoubleStorage", NAME_STORAGE, CORE_F64},
    {"torch", "HalfStorage", NAME_STORAGE, CORE_F16},
    {"torch", "BFloat16Storage", NAME_STORAGE, CORE_BF16},
    {"torch", "LongStorage", NAME_STORAGE, CORE_I64},
    {"torch", "IntStorage", NAME_STORAGE, CORE_I32},
    {"torch", "ByteStorage", NAME_STORAGE, CORE_U8},
    {"torch", "BoolStorage", NAME_STORAGE, CORE_U8},
};
enum { NAMES = sizeof names / sizeof names[0] };

/* ---- the machine ---- */

struct nn_pickle {
    core_arena *arena;
    size_t values; /* and items made */
    const nn_value *result;
};

typedef struct machine {
    nn_pickle *pickle;
    const unsigned char *data;
    size_t size, at;
    const nn_value **stack; /* NULL: a mark */
    size_t height, room;
    const nn_value **memo;
    size_t memo_count;
    const char *name;
    brace_error *error;
    brace_status status;
} machine;

static void fail(machine *m, brace_status status, const char *what) {
    if (m->status == BRACE_OK) {
        m->status = core_fail(m->error, status, "%s: %s", m->name, what);
    }
}

static void damaged(machine *m) {
    fail(m, BRACE_ERROR_FORMAT, "damaged, or cut off: its description of the tensors makes no sense");
}

static void *make(machine *m, size_t size) {
    if (m->pickle->values >= NN_PICKLE_VALUES) {
        fail(m, BRACE_ERROR_UNSUPPORTED, "it holds more than a million values");
        return NULL;
    }
    m->pickle->values++;
    void *p = core_arena_alloc(m->pickle->arena, 1, size);
    if (p == NULL && m->status == BRACE_OK) {
        m->status = core_fail_memory(m->error, size, "a list of tensors");
    }
    return p;
}

static nn_value *make_value(machine *m, nn_kind kind) {
    nn_value *v = make(m, sizeof *v);
    if (v != NULL) {
        v->kind = kind;
    }
    return v;
}

/* Doubles a list of pointers. */
static bool grow(machine *m, const nn_value ***list, size_t *room, size_t needed) {
    size_t more = *room < 64 ? 64 : *room;
    while (more < needed) {
        more *= 2;
    }
    const nn_value **grown = core_alloc(more, sizeof *grown);
    if (grown == NULL) {
        if (m->status == BRACE_OK) {
            m->status = core_fail_memory(m->error, more * sizeof *grown, "a list of tensors");
        }
        return false;
    }
    if (*room > 0) {
        memcpy((void *)grown, (const void *)*list, *room * sizeof *grown);
    }
    memset((void *)(grown + *room), 0, (more - *room) * sizeof *grown);
    core_free((void *)*list);
    *list = grown;
    *room = more;
    return true;
}

static void push(machine *m, const nn_value *v) {
    if (m->status == BRACE_OK && (m->height < m->room || grow(m, &m->stack, &m->room, m->height + 1))) {
        m->stack[m->height++] = v;
    }
}

/* The value on top, taken off; NULL after an error. */
static const nn_value *pop(machine *m) {
    if (m->height == 0 || m->stack[m->height - 1] == NULL) {
        damaged(m);
        return NULL;
    }
    return m->stack[--m->height];
}

/* The place after the last mark; SIZE_MAX after an error. */
static size_t mark(machine *m) {
    for (size_t i = m->height; i > 0; i--) {
        if (m->stack[i - 1] == NULL) {
            return i;
        }
    }
    damaged(m);
    return SIZE_MAX;
}

static void append(machine *m, nn_value *container, const nn_value *key, const nn_value *value) {
    nn_item *item = make(m, sizeof *item);
    if (item != NULL) {
        *item = (nn_item){key, value, NULL};
        if (container->items.last != NULL) {
            container->items.last->next = item;
        } else {
            container->items.first = item;
        }
        container->items.last = item;
        container->items.count++;
    }
}

/* Values are const to whoever reads them; while the machine runs, containers grow. */
static nn_value *container(machine *m, const nn_value *v, nn_kind kind) {
    if (v == NULL || v->kind != kind) {
        damaged(m);
        return NULL;
    }
    return (nn_value *)(uintptr_t)v;
}

/* ---- reading operands ---- */

static uint64_t number(machine *m, size_t bytes) {
    uint64_t v = 0;
    if (bytes > m->size - m->at) {
        damaged(m);
        return 0;
    }
    for (size_t i = 0; i < bytes; i++) {
        v |= (uint64_t)m->data[m->at + i] << 8 * i;
    }
    m->at += bytes;
    return v;
}

static void push_int(machine *m, nn_kind kind, int64_t integer) {
    nn_value *v = make_value(m, kind);
    if (v != NULL) {
        v->integer = integer;
        push(m, v);
    }
}

/* A whole number of n bytes, two's complement. */
static void push_long(machine *m, uint64_t n) {
    if (n > 8) {
        fail(m, BRACE_ERROR_UNSUPPORTED, "it holds a whole number of more than 64 bits");
        return;
    }
    uint64_t v = number(m, (size_t)n);
    if (n > 0 && n < 8 && v >> (8 * n - 1) != 0) {
        v |= UINT64_MAX << 8 * n;
    }
    push_int(m, NN_INT, (int64_t)v);
}

static void push_text(machine *m, uint64_t length) {
    if (length > m->size - m->at) {
        damaged(m);
        return;
    }
    nn_value *v = make_value(m, NN_TEXT);
    if (v != NULL) {
        v->text.start = (const char *)m->data + m->at;
        v->text.length = (size_t)length;
        m->at += (size_t)length;
        push(m, v);
    }
}

/* ---- names and calls ---- */

static bool same(const char *text, size_t length, const char *other) {
    return strlen(other) == length && memcmp(text, other, length) == 0;
}

bool nn_text_is(const nn_value *value, const char *text) {
    return value != NULL && value->kind == NN_TEXT && same(value->text.start, value->text.length, text);
}

/* What a file may be shown of. */
static void printable(char out[64], const char *text, size_t length) {
    size_t n = length < 63 ? length : 63;
    for (size_t i = 0; i < n; i++) {
        out[i] = text[i] >= 32 && text[i] < 127 ? text[i] : '?';
    }
    out[n] = '\0';
}

static void push_name(machine *m, const char *module, size_t module_length, const char *name, size_t length) {
    for (int i = 0; i < NAMES; i++) {
        if (same(module, module_length, names[i].module) && same(name, length, names[i].name)) {
            push_int(m, NN_NAME, i);
            return;
        }
    }
    char a[64], b[64];
    printable(a, module, module_length);
    printable(b, name, length);
    if (m->status == BRACE_OK) {
        m->status =
            core_fail(m->error, BRACE_ERROR_UNSUPPORTED,
                      "%s: it asks for '%s.%s', which BRACE does not know; only files of plain tensors are read, "
                      "and nothing in them is ever executed",
                      m->name, a, b);
    }
}

/* Two lines: module and name. */
static void global(machine *m) {
    const char *start[2];
    size_t length[2];
    for (int i = 0; i < 2; i++) {
        start[i] = (const char *)m->data + m->at;
        const char *end = memchr(start[i], '\n', m->size - m->at);
        if (end == NULL) {
            damaged(m);
            return;
        }
        length[i] = (size_t)(end - start[i]);
        m->at += length[i] + 1;
    }
    push_name(m, start[0], length[0], start[1], length[1]);
}

static const nn_value *argument(const nn_value *tuple, size_t index) {
    const nn_item *item = tuple->items.first;
    for (; item != NULL && index > 0; index--) {
        item = item->next;
    }
    return item != NULL ? item->value : NULL;
}

static bool natural(const nn_value *v, uint64_t *out) {
    if (v == NULL || v->kind != NN_INT || v->integer < 0) {
        return false;
    }
    *out = (uint64_t)v->integer;
    return true;
}

/* A tuple of whole numbers; -1 if it is none. */
static int naturals(const nn_value *tuple, uint64_t out[CORE_TENSOR_RANK]) {
    if (tuple == NULL || tuple->kind != NN_TUPLE || tuple->items.count > CORE_TENSOR_RANK) {
        return -1;
    }
    int n = 0;
    for (const nn_item *item = tuple->items.first; item != NULL; item = item->next) {
        if (!natural(item->value, &out[n++])) {
            return -1;
        }
    }
    return n;
}

/* Checks that all of the view lies in its storage. */
static const nn_value *rebuild_tensor(machine *m, const nn_value *arguments) {
    const nn_value *storage = argument(arguments, 0);
    uint64_t offset = 0, stride[CORE_TENSOR_RANK] = {0};
    nn_value *t = make_value(m, NN_TENSOR);
    if (t == NULL) {
        return NULL;
    }
    t->tensor.rank = naturals(argument(arguments, 2), t->tensor.shape);
    if (storage == NULL || storage->kind != NN_STORAGE || !natural(argument(arguments, 1), &offset) ||
        t->tensor.rank < 0 || naturals(argument(arguments, 3), stride) != t->tensor.rank) {
        damaged(m);
        return NULL;
    }
    uint64_t last, count = 1;
    bool bad = __builtin_add_overflow(offset, storage->storage.first, &last);
    t->tensor.offset = last;
    for (int i = 0; i < t->tensor.rank; i++) {
        bad = bad || __builtin_mul_overflow(count, t->tensor.shape[i], &count);
    }
    for (int i = 0; !bad && count > 0 && i < t->tensor.rank; i++) {
        uint64_t reach;
        bad = __builtin_mul_overflow(t->tensor.shape[i] - 1, stride[i], &reach) ||
              __builtin_add_overflow(last, reach, &last);
    }
    if (bad || (count > 0 ? last >= storage->storage.count : last > storage->storage.count)) {
        fail(m, BRACE_ERROR_FORMAT, "a tensor in it is larger than the numbers that are there");
        return NULL;
    }
    memcpy(t->tensor.stride, stride, sizeof stride);
    t->tensor.storage = storage;
    return t;
}

/* OrderedDict() or OrderedDict([[key, value], ...]). */
static const nn_value *ordered_dict(machine *m, const nn_value *arguments) {
    nn_value *dict = make_value(m, NN_DICT);
    const nn_value *pairs = argument(arguments, 0);
    if (dict == NULL || pairs == NULL) {
        return dict;
    }
    if (pairs->kind != NN_LIST) {
        damaged(m);
        return NULL;
    }
    for (const nn_item *item = pairs->items.first; item != NULL; item = item->next) {
        const nn_value *pair = item->value;
        if ((pair->kind != NN_LIST && pair->kind != NN_TUPLE) || pair->items.count != 2) {
            damaged(m);
            return NULL;
        }
        append(m, dict, argument(pair, 0), argument(pair, 1));
    }
    return dict;
}

static void reduce(machine *m) {
    const nn_value *arguments = pop(m), *name = pop(m), *result = NULL;
    if (arguments == NULL || name == NULL || arguments->kind != NN_TUPLE || name->kind != NN_NAME) {
        damaged(m);
        return;
    }
    switch (names[name->integer].kind) {
    case NAME_DICT:
        result = ordered_dict(m, arguments);
        break;
    case NAME_TENSOR:
        result = rebuild_tensor(m, arguments);
        break;
    case NAME_PARAMETER:
        result = argument(arguments, 0);
        result = result != NULL && result->kind == NN_TENSOR ? result : NULL;
        break;
    case NAME_SIZE:
        result = argument(arguments, 0);
        result = result != NULL && result->kind == NN_TUPLE ? result : NULL;
        break;
    case NAME_STORAGE:
        break;
    }
    if (result == NULL) {
        damaged(m);
    }
    push(m, result);
}

/* ('storage', type, key, device, count), in old files also the part of it that is seen, or None. */
static void persistent(machine *m) {
    const nn_value *id = pop(m);
    nn_value *s = make_value(m, NN_STORAGE);
    if (id == NULL || s == NULL) {
        return;
    }
    if (id->kind != NN_TUPLE || !nn_text_is(argument(id, 0), "storage")) {
        damaged(m);
        return;
    }
    const nn_value *type = argument(id, 1), *key = argument(id, 2), *view = argument(id, 5);
    if (type == NULL || type->kind != NN_NAME || names[type->integer].kind != NAME_STORAGE || key == NULL ||
        key->kind != NN_TEXT || !natural(argument(id, 4), &s->storage.count)) {
        damaged(m);
        return;
    }
    s->storage.dtype = names[type->integer].dtype;
    s->storage.key = key;
    if (view != NULL && view->kind != NN_NONE &&
        (view->kind != NN_TUPLE || !natural(argument(view, 1), &s->storage.first) ||
         s->storage.first > s->storage.count)) {
        damaged(m);
        return;
    }
    push(m, s);
}

/* ---- containers ---- */

static void push_tuple(machine *m, size_t from, size_t marks) {
    nn_value *t = from != SIZE_MAX ? make_value(m, NN_TUPLE) : NULL;
    if (t == NULL) {
        return;
    }
    for (size_t i = from; i < m->height; i++) {
        if (m->stack[i] == NULL) {
            damaged(m);
            return;
        }
        append(m, t, NULL, m->stack[i]);
    }
    m->height = from - marks;
    push(m, t);
}

/* Adds what lies on the stack from `from` on to the list or dict below it, which stays. */
static void extend(machine *m, size_t from, size_t marks, nn_kind kind) {
    if (from == SIZE_MAX || from < marks + 1) {
        damaged(m);
        return;
    }
    nn_value *to = container(m, m->stack[from - marks - 1], kind);
    const size_t step = kind == NN_DICT ? 2 : 1;
    if (to == NULL || (m->height - from) % step != 0) {
        damaged(m);
        return;
    }
    for (size_t i = from; i < m->height; i += step) {
        if (m->stack[i] == NULL || m->stack[i + step - 1] == NULL) {
            damaged(m);
            return;
        }
        append(m, to, kind == NN_DICT ? m->stack[i] : NULL, m->stack[i + step - 1]);
    }
    m->height = from - marks;
}

static void put(machine *m, uint64_t index) {
    if (m->height == 0 || m->stack[m->height - 1] == NULL || index >= NN_PICKLE_VALUES) {
        damaged(m);
        return;
    }
    if (index < m->memo_count || grow(m, &m->memo, &m->memo_count, (size_t)index + 1)) {
        m->memo[index] = m->stack[m->height - 1];
    }
}

static void get(machine *m, uint64_t index) {
    if (index >= m->memo_count || m->memo[index] == NULL) {
        damaged(m);
        return;
    }
    push(m, m->memo[index]);
}

/* The state of an object: only attributes of dicts and tensors, which nobody asks for. */
static void build(machine *m) {
    const nn_value *state = pop(m);
    if (state == NULL || m->height == 0 || m->stack[m->height - 1] == NULL) {
        damaged(m);
        return;
    }
    const nn_kind kind = m->stack[m->height - 1]->kind;
    if ((state->kind != NN_DICT && state->kind != NN_TUPLE) || (kind != NN_DICT && kind != NN_TENSOR)) {
        damaged(m);
    }
}

static void push_double(machine *m) {
    number(m, 8); /* no number that a tensor needs */
    push_int(m, NN_FLOAT, 0);
}

static size_t below(machine *m, size_t n) {
    if (m->height < n) {
        damaged(m);
        return SIZE_MAX;
    }
    return m->height - n;
}

/* One instruction; true after the last. */
static bool step(machine *m, size_t *memoized) {
    const unsigned op = (unsigned)number(m, 1);
    if (m->status != BRACE_OK) {
        return true;
    }
    switch (op) {
    case 0x80: /* PROTO */
        if (number(m, 1) > 5) {
            damaged(m);
        }
        break;
    case 0x95: /* FRAME */
        number(m, 8);
        break;
    case '.': /* STOP */
        m->pickle->result = pop(m);
        return true;
    case '(':
        push(m, NULL);
        break;
    case '0': /* POP */
        pop(m);
        break;
    case '1': /* POP_MARK */
    {
        size_t from = mark(m);
        m->height = from != SIZE_MAX ? from - 1 : m->height;
        break;
    }
    case 'N':
        push_int(m, NN_NONE, 0);
        break;
    case 0x88: /* NEWTRUE */
    case 0x89: /* NEWFALSE */
        push_int(m, NN_BOOL, op == 0x88);
        break;
    case 'J': /* BININT */
        push_int(m, NN_INT, (int32_t)(uint32_t)number(m, 4));
        break;
    case 'K': /* BININT1 */
        push_int(m, NN_INT, (int64_t)number(m, 1));
        break;
    case 'M': /* BININT2 */
        push_int(m, NN_INT, (int64_t)number(m, 2));
        break;
    case 0x8a: /* LONG1 */
        push_long(m, number(m, 1));
        break;
    case 0x8b: /* LONG4 */
        push_long(m, number(m, 4));
        break;
    case 'G': /* BINFLOAT */
        push_double(m);
        break;
    case 'U':  /* SHORT_BINSTRING */
    case 'C':  /* SHORT_BINBYTES */
    case 0x8c: /* SHORT_BINUNICODE */
        push_text(m, number(m, 1));
        break;
    case 'T': /* BINSTRING */
    case 'B': /* BINBYTES */
    case 'X': /* BINUNICODE */
        push_text(m, number(m, 4));
        break;
    case 0x8d: /* BINUNICODE8 */
        push_text(m, number(m, 8));
        break;
    case ')':
        push_tuple(m, m->height, 0);
        break;
    case 't': /* TUPLE */
        push_tuple(m, mark(m), 1);
        break;
    case 0x85: /* TUPLE1 */
    case 0x86:
    case 0x87:
        push_tuple(m, below(m, op - 0x84), 0);
        break;
    case ']':
        push(m, make_value(m, NN_LIST));
        break;
    case '}':
        push(m, make_value(m, NN_DICT));
        break;
    case 'a': /* APPEND */
        extend(m, below(m, 1), 0, NN_LIST);
        break;
    case 'e': /* APPENDS */
        extend(m, mark(m), 1, NN_LIST);
        break;
    case 's': /* SETITEM */
        extend(m, below(m, 2), 0, NN_DICT);
        break;
    case 'u': /* SETITEMS */
        extend(m, mark(m), 1, NN_DICT);
        break;
    case 'q': /* BINPUT */
        put(m, number(m, 1));
        break;
    case 'r': /* LONG_BINPUT */
        put(m, number(m, 4));
        break;
    case 0x94: /* MEMOIZE */
        put(m, (*memoized)++);
        break;
    case 'h': /* BINGET */
        get(m, number(m, 1));
        break;
    case 'j': /* LONG_BINGET */
        get(m, number(m, 4));
        break;
    case 'c':
        global(m);
        break;
    case 0x93: /* STACK_GLOBAL */
    {
        const nn_value *name = pop(m), *module = pop(m);
        if (name == NULL || module == NULL || name->kind != NN_TEXT || module->kind != NN_TEXT) {
            damaged(m);
        } else {
            push_name(m, module->text.start, module->text.length, name->text.start, name->text.length);
        }
        break;
    }
    case 'R':
        reduce(m);
        break;
    case 'b':
        build(m);
        break;
    case 'Q': /* BINPERSID */
        persistent(m);
        break;
    default:
        if (m->status == BRACE_OK) {
            m->status = core_fail(m->error, BRACE_ERROR_UNSUPPORTED,
                                  "%s: damaged, or more than a file of plain tensors: instruction 0x%02x", m->name, op);
        }
    }
    return m->status != BRACE_OK;
}

brace_status nn_pickle_read(nn_pickle **out, size_t *used, const void *data, size_t size, const char *name,
                            brace_error *error) {
    *out = NULL;
    machine m = {.data = data,
                 .size = size < NN_PICKLE_SIZE ? size : NN_PICKLE_SIZE,
                 .name = name,
                 .error = error,
                 .status = BRACE_OK};
    m.pickle = core_calloc(1, sizeof *m.pickle);
    if (m.pickle != NULL) {
        m.pickle->arena = core_arena_create((size_t)64 << 10);
    }
    if (m.pickle == NULL || m.pickle->arena == NULL) {
        nn_pickle_destroy(m.pickle);
        return core_fail_memory(error, sizeof *m.pickle, "a list of tensors");
    }
    size_t memoized = 0;
    while (!step(&m, &memoized)) {
    }
    core_free((void *)m.stack);
    core_free((void *)m.memo);
    if (m.status != BRACE_OK) {
        nn_pickle_destroy(m.pickle);
        return m.status;
    }
    *out = m.pickle;
    *used = m.at;
    return BRACE_OK;
}

void nn_pickle_destroy(nn_pickle *pickle) {
    if (pickle != NULL) {
        core_arena_destroy(pickle->arena);
        core_free(pickle);
    }
}

const nn_value *nn_pickle_result(const nn_pickle *pickle) {
    return pickle->result;
}
