/* Draws the garden as SVG: an observer. The file is the first argument, or garden.svg. */

#include <inttypes.h>
#include <stdio.h>

#include "../src/minerva.h"

typedef struct picture {
    const char *file;
    size_t shells;
} picture;

static void draw(const mb_view *view, void *state) {
    picture *self = state;
    FILE *out = fopen(self->file, "w");
    self->shells = view->count;
    if (out == NULL) return;
    const size_t width = 10 + 30 * (view->count > 5 ? view->count : 5);
    fprintf(out, "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %zu 60\">", width);
    fprintf(out, "<text x=\"5\" y=\"12\" font-size=\"10\" font-family=\"sans-serif\">");
    fprintf(out, "frame %" PRId64 ": %zu snails</text>", view->frame, view->count);
    for (size_t n = 0; n < view->count; n++)
        fprintf(out, "<circle cx=\"%zu\" cy=\"40\" r=\"%g\" fill=\"#886644\"/>", 20 + 30 * n,
                2 * mb_number(&view->nodes[n].values[0]));
    fprintf(out, "</svg>\n");
    fclose(out);
}

static void report(const void *state, mb_map *figures) {
    mb_set(figures, "shells", mb_int((int64_t)((const picture *)state)->shells));
}

int main(int count, char **arguments) {
    picture self = {.file = count > 1 ? arguments[1] : "garden.svg"};
    return mb_run_device(&(mb_device){
        .service = "picture",
        .draws = MB_TEXTS("eShow"),
        .when = "each 10 frames",
        .state = &self,
        .draw = draw,
        .report = report,
    });
}
