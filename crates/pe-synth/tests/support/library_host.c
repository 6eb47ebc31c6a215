/* Calls a reference that was built as a library, as lines on standard input say, and prints what each call gives.

   library_host LIBRARY PREFIX; slots hold networks, words are decimal:

   new SLOT FORM     free SLOT         counts            step SLOT N       reset SLOT       clear SLOT
   in SLOT WORD...   out SLOT COUNT    state SLOT COUNT  set SLOT WORD...  move FROM TO     flags SLOT
   nulls SLOT        calls every function without what it needs; prints what they return */
#include <dlfcn.h>
#include <inttypes.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SLOTS = 8 };

typedef struct network network;

static void *library;
static const char *prefix;

static void *function(const char *name) {
    char full[256];
    snprintf(full, sizeof full, "%s_%s", prefix, name);
    void *found = dlsym(library, full);
    if (!found) {
        fprintf(stderr, "no function %s\n", full);
        exit(2);
    }
    return found;
}

/* The words behind a command; the caller frees them. */
static int64_t *words(char *text, size_t *count) {
    size_t room = strlen(text) / 2 + 1;
    int64_t *found = malloc(room * sizeof *found);
    *count = 0;
    for (char *word = strtok(text, " \n"); word; word = strtok(NULL, " \n")) {
        found[(*count)++] = strtoll(word, NULL, 10);
    }
    return found;
}

static void show(const char *what, int32_t code, const int64_t *found, size_t count) {
    printf("%s %" PRId32, what, code);
    for (size_t index = 0; code >= 0 && index < count; index++) {
        printf(" %" PRId64, found[index]);
    }
    printf("\n");
}

int main(int argc, char **argv) {
    if (argc != 3 || !(library = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL))) {
        fprintf(stderr, "no library: %s\n", dlerror());
        return 2;
    }
    prefix = argv[2];
    int32_t (*interface)(void) = function("interface");
    const char *(*hash)(void) = function("hash");
    size_t (*inputs)(void) = function("inputs");
    size_t (*outputs)(void) = function("outputs");
    size_t (*state_words)(void) = function("state_words");
    uint32_t (*clocks)(void) = function("clocks");
    network *(*new)(int32_t) = function("new");
    void (*free_network)(network *) = function("free");
    int32_t (*reset)(network *) = function("reset");
    int32_t (*step)(network *, uint64_t) = function("step");
    int32_t (*set_inputs)(network *, const int64_t *, size_t) = function("set_inputs");
    int32_t (*get_outputs)(network *, int64_t *, size_t) = function("get_outputs");
    int32_t (*get_state)(network *, int64_t *, size_t) = function("get_state");
    int32_t (*set_state)(network *, const int64_t *, size_t) = function("set_state");
    int32_t (*flags)(network *, uint32_t *) = function("flags");
    int32_t (*clear_flags)(network *) = function("clear_flags");
    network *networks[SLOTS] = {0};
    char *line = NULL;
    size_t room = 0;
    while (getline(&line, &room, stdin) > 0) {
        size_t count;
        char *rest = strchr(line, ' ');
        int64_t *numbers = words(rest ? rest : line + strlen(line), &count);
        line[strcspn(line, " \n")] = 0;
        network **slot = &networks[count ? numbers[0] % SLOTS : 0];
        int64_t *others = numbers + 1;
        if (!strcmp(line, "counts")) {
            printf("counts %" PRId32 " %zu %zu %zu %" PRIu32 " %s\n", interface(), inputs(), outputs(), state_words(),
                   clocks(), hash());
        } else if (!strcmp(line, "new")) {
            *slot = new((int32_t)others[0]);
            printf("new %d\n", *slot != NULL);
        } else if (!strcmp(line, "free")) {
            free_network(*slot);
            *slot = NULL;
            printf("free\n");
        } else if (!strcmp(line, "in")) {
            show("in", set_inputs(*slot, others, count - 1), NULL, 0);
        } else if (!strcmp(line, "step")) {
            show("step", step(*slot, (uint64_t)others[0]), NULL, 0);
        } else if (!strcmp(line, "out") || !strcmp(line, "state")) {
            size_t wanted = (size_t)others[0];
            int64_t *found = calloc(wanted + 1, sizeof *found);
            int32_t code = line[0] == 'o' ? get_outputs(*slot, found, wanted) : get_state(*slot, found, wanted);
            show(line, code, found, wanted);
            free(found);
        } else if (!strcmp(line, "set")) {
            show("set", set_state(*slot, others, count - 1), NULL, 0);
        } else if (!strcmp(line, "move")) {
            int64_t *found = calloc(state_words() + 1, sizeof *found);
            int32_t code = get_state(*slot, found, state_words());
            show("move", code ? code : set_state(networks[others[0]], found, state_words()), NULL, 0);
            free(found);
        } else if (!strcmp(line, "reset")) {
            show("reset", reset(*slot), NULL, 0);
        } else if (!strcmp(line, "clear")) {
            show("clear", clear_flags(*slot), NULL, 0);
        } else if (!strcmp(line, "flags")) {
            uint32_t found = 0;
            int32_t code = flags(*slot, &found);
            printf("flags %" PRId32 " %" PRIu32 "\n", code, found);
        } else if (!strcmp(line, "nulls")) {
            int64_t word = 0;
            uint32_t found = 0;
            free_network(NULL);
            printf("nulls %d %d %d %d %d %d %d %d", reset(NULL), step(NULL, 1), set_inputs(NULL, &word, 1),
                   get_outputs(NULL, &word, 1), get_state(NULL, &word, 1), set_state(NULL, &word, 1),
                   flags(NULL, &found), clear_flags(NULL));
            printf(" %d %d %d %d %d %d\n", set_inputs(*slot, NULL, inputs() + 1), get_outputs(*slot, NULL, outputs()),
                   get_state(*slot, NULL, state_words()), set_state(*slot, NULL, SIZE_MAX), flags(*slot, NULL),
                   get_outputs(*slot, &word, SIZE_MAX));
        } else {
            fprintf(stderr, "what is %s?\n", line);
            return 2;
        }
        free(numbers);
    }
    return 0;
}
