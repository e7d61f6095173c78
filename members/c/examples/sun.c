/* The sun shines in every frame: a generator without state. */

#include "../src/minerva.h"

static void tick(mb_moment *moment, void *state) {
    (void)state;
    mb_emit(moment, (mb_event){.type = mb_text("eSun"), .values = MB_LIST(mb_real(0.2))});
}

int main(void) {
    return mb_run_generator(&(mb_generator){.service = "sun", .generates = MB_TEXTS("eSun"), .tick = tick});
}
