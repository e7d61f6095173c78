/* Rain in every second frame: a generator that counts its showers, also across a restart. */

#include "../src/minerva.h"

static void tick(mb_moment *moment, void *state) {
    int64_t *showers = state;
    if (moment->frame % 2 != 0) return;
    *showers += 1;
    mb_emit(moment, (mb_event){.type = mb_text("eRain")});
}

static void save(const void *state, mb_map *saved) { mb_set(saved, "showers", mb_int(*(const int64_t *)state)); }

static void restore(void *state, const mb_value *saved) {
    const mb_value *showers = mb_find(saved, "showers");
    if (showers != NULL && showers->type == MB_INT) *(int64_t *)state = showers->integer;
}

int main(void) {
    int64_t showers = 0;
    return mb_run_generator(&(mb_generator){
        .service = "rain",
        .generates = MB_TEXTS("eRain"),
        .state = &showers,
        .tick = tick,
        .save = save,
        .restore = restore,
        .report = save,
    });
}
