/* SPDX-License-Identifier: MIT */
#include "vs_words.h"

#include <string.h>

#include "vs_math.h"
#include "vs_sums.h"

#define SHORT 12          /* likeliest words that are looked at closely */
#define TURNS 4           /* words of a tag */
#define TOGETHER 256      /* words whose likeness is added up at once */
#define LEAST_LIKE -2.0F  /* less than any likeness, which is a correlation */
#define BLUR_LESS 2       /* how much sharper than its edges a marker may be, in levels */
#define BLUR_MORE 1       /* and how much more blurred */
#define LEAST_START 0.6   /* likeness of the best word before other blurs are tried */
#define LEAST_MARGIN 1.2
#define MOST_ERROR 0.25
#define WRONG 0.5         /* a cell that is farther than this from its word's is wrong */

/* Cells as they are compared: without mean and slope, of unit length, 0 where not used. */
struct seen {
    int span, ring; /* ring is 1 where the white around is used, too */
    vs_line cell[VS_WORDS_SPAN];
};

/* The likeliest words of a reading, the first the likeliest, under all blurs so far. */
struct shortlist {
    int count;
    int word[SHORT];
    float likeness[SHORT];
    int kind[SHORT];
};

static int is_used(const struct seen *s, int row, int column)
{
    int last = s->span - 1;
    int edges = (row == 0) + (row == last) + (column == 0) + (column == last);

    return edges == 0 || (edges == 1 && s->ring);
}

/*
 * Takes mean and slope out of the used cells, whose places are symmetrical, and gives them unit
 * length; returns the length before.
 */
static double flatten(struct seen *s)
{
    double sum = 0.0, along = 0.0, down = 0.0, places = 0.0, squares = 0.0, length = 0.0;
    double middle = 0.5 * (s->span - 1);
    int row, column;

    for (row = 0; row < s->span; row++) {
        for (column = 0; column < s->span; column++) {
            double grey = (double)s->cell[row][column];

            if (!is_used(s, row, column))
                continue;
            sum += grey;
            along += (column - middle) * grey;
            down += (row - middle) * grey;
            places += 1.0;
            squares += (column - middle) * (column - middle);
        }
    }
    for (row = 0; row < s->span; row++) {
        for (column = 0; column < s->span; column++) {
            double slope = ((column - middle) * along + (row - middle) * down) / squares;
            double flat = (double)s->cell[row][column] - sum / places - slope;

            flat = is_used(s, row, column) ? flat : 0.0;
            s->cell[row][column] = (float)flat;
            length += flat * flat;
        }
    }
    length = vs_most(vs_root(length), 1e-6);
    for (row = 0; row < s->span; row++) {
        for (column = 0; column < VS_WORDS_SPAN; column++)
            s->cell[row][column] *= (float)(1.0 / length);
    }
    return length;
}

/* One over the length of words as they are seen; a quarter turn exchanges the blurs. */
static const float *per_length(const struct vs_words *w, int ring, int turn, int u, int v)
{
    int kind = turn & 1 ? v * VS_WORDS_BLURS + u : u * VS_WORDS_BLURS + v;

    return w->per_length[ring] + (size_t)kind * (size_t)w->tags;
}

/* Puts a word into the list; the last one gives way where there is no room. */
static void add_word(struct shortlist *list, int word, int kind, float likeness)
{
    int place = list->count;

    if (place == SHORT)
        place--;
    else
        list->count++;
    for (; place > 0 && likeness > list->likeness[place - 1]; place--) {
        list->word[place] = list->word[place - 1];
        list->likeness[place] = list->likeness[place - 1];
        list->kind[place] = list->kind[place - 1];
    }
    list->word[place] = word;
    list->likeness[place] = likeness;
    list->kind[place] = kind;
}

/* Puts a tag's words into the list; returns the likeness that another needs from now on. */
static float add_tag(struct shortlist *list, int first, int kind, const float *likeness)
{
    int i;

    for (i = 0; i < TURNS; i++) {
        if (list->count < SHORT || likeness[i] > list->likeness[SHORT - 1])
            add_word(list, first + i, kind, likeness[i]);
    }
    return list->count < SHORT ? LEAST_LIKE : list->likeness[SHORT - 1];
}

/* Finds the words that are the likeliest under one blur. */
static void list_words(const struct vs_words *w, const struct seen *s, int u, int v,
                       struct shortlist *list)
{
    struct vs_sums sums;
    vs_line lines[VS_WORDS_SPAN];
    float sum[TOGETHER], least = LEAST_LIKE; /* of what the list has room for */
    const float *upright = per_length(w, s->ring, 0, u, v);
    const float *turned = per_length(w, s->ring, 1, u, v);
    int kind = u * VS_WORDS_BLURS + v, words = TURNS * w->tags, first, i;

    vs_sums_rows(w, s->cell, v, lines);
    vs_sums_weigh(w, (const vs_line *)lines, u, &sums);
    list->count = 0;
    for (first = 0; first < words; first += TOGETHER) {
        int count = words - first < TOGETHER ? words - first : TOGETHER;

        vs_sums_add(&sums, w->part + (size_t)first * (size_t)sums.parts, count, sum);
        for (i = 0; i < count; i += TURNS) {
            float a = sum[i] * upright[(first + i) / TURNS];
            float b = sum[i + 1] * turned[(first + i) / TURNS];
            float c = sum[i + 2] * upright[(first + i) / TURNS];
            float d = sum[i + 3] * turned[(first + i) / TURNS];

            if (a > least || b > least || c > least || d > least)
                least = add_tag(list, first + i, kind, (const float[TURNS]){a, b, c, d});
        }
    }
}

/* Tries listed words under another blur; their likeness is that of the blur that suits best. */
static void try_blur(const struct vs_words *w, const struct seen *s, int u, int v,
                     const vs_line *lines, struct shortlist *list)
{
    struct vs_sums sums;
    int place;

    vs_sums_weigh(w, lines, u, &sums);
    for (place = 0; place < list->count; place++) {
        int word = list->word[place];
        float likeness;

        vs_sums_add(&sums, w->part + (size_t)word * (size_t)sums.parts, 1, &likeness);
        likeness *= per_length(w, s->ring, word, u, v)[word / 4];
        if (likeness > list->likeness[place]) {
            list->likeness[place] = likeness;
            list->kind[place] = u * VS_WORDS_BLURS + v;
        }
    }
}

/* What a camera would see of a word: between 0, black, and 1, white. */
static void see_word(const struct vs_words *w, uint64_t word, int kind, struct seen *ideal)
{
    const vs_line *across = w->seen[kind / VS_WORDS_BLURS];
    const vs_line *down = w->seen[kind % VS_WORDS_BLURS];
    int side = w->cells + 2, row, column, i, k;
    vs_line dark[VS_WORDS_SPAN];

    memset(dark, 0, sizeof dark);
    for (i = 0; i < side; i++) {
        for (k = 0; k < side; k++) {
            int bit = (i - 1) * w->cells + k - 1;
            int is_inner = i > 0 && k > 0 && i < side - 1 && k < side - 1;

            if (is_inner && (word >> bit & 1) != 0)
                continue;
            for (column = 0; column < ideal->span; column++)
                dark[i][column] += across[column][k];
        }
    }
    for (row = 0; row < ideal->span; row++) {
        for (column = 0; column < VS_WORDS_SPAN; column++)
            ideal->cell[row][column] = 1.0F;
        for (i = 0; i < side; i++)
            vs_sums_line(ideal->cell[row], -down[row][i], dark[i]);
    }
}

/* The correlation of the cells of the matrix. */
static double match(const struct seen *s, const struct seen *ideal)
{
    double n = 0.0, a = 0.0, b = 0.0, aa = 0.0, ab = 0.0, bb = 0.0;
    int row, column;

    for (row = 2; row < s->span - 2; row++) {
        for (column = 2; column < s->span - 2; column++) {
            double x = (double)s->cell[row][column];
            double y = (double)ideal->cell[row][column];

            n += 1.0;
            a += x;
            b += y;
            aa += x * x;
            ab += x * y;
            bb += y * y;
        }
    }
    return (ab - a * b / n) / vs_most(vs_root((aa - a * a / n) * (bb - b * b / n)), 1e-9);
}

/* Sets the error; gives the number of the matrix's cells that are not the word's. */
static int count_wrong(const struct seen *s, const struct seen *ideal, double likeness,
                       double length, double *error)
{
    double sum = 0.0, used = 0.0, per = length / vs_most(likeness, 1e-6);
    int wrong = 0, row, column;

    for (row = 0; row < s->span; row++) {
        for (column = 0; column < s->span; column++) {
            double miss = per * ((double)s->cell[row][column] -
                                 likeness * (double)ideal->cell[row][column]);
            int inner = row > 1 && column > 1 && row < s->span - 2 && column < s->span - 2;

            if (!is_used(s, row, column))
                continue;
            sum += miss * miss;
            used += 1.0;
            wrong += inner && (miss > WRONG || miss < -WRONG);
        }
    }
    *error = vs_root(sum / used);
    return wrong;
}

/* Sets error and margin of the list's first word, and whether to believe it. */
static void judge(const struct vs_words *w, const struct seen *s, const struct shortlist *list,
                  int best, struct vs_reading *reading)
{
    double likeness = (double)list->likeness[best], next = 0.0, length;
    int kind = list->kind[best], wrong, i;
    struct seen ideal;

    ideal.span = s->span;
    ideal.ring = s->ring;
    see_word(w, w->word[list->word[best]], kind, &ideal);
    length = flatten(&ideal);
    for (i = 0; i < list->count; i++) {
        if (list->word[i] / 4 != list->word[best] / 4)
            next = vs_most(next, (double)list->likeness[i]);
    }
    wrong = count_wrong(s, &ideal, likeness, length, &reading->error);
    reading->margin = vs_root(vs_most(1.0 - next * next, 1e-9) /
                              vs_most(1.0 - likeness * likeness, 1e-9));
    reading->sure = match(s, &ideal) > w->least_match[s->ring][kind] &&
                    reading->margin > LEAST_MARGIN && reading->error < MOST_ERROR &&
                    wrong <= w->correction;
}

/* Tries the listed words under all blurs near to those that were measured. */
static void try_blurs(const struct vs_words *w, const struct seen *s, const int32_t level[2],
                      struct shortlist *list)
{
    vs_line lines[VS_WORDS_SPAN];
    int u, v;

    for (v = level[1] - BLUR_LESS; v <= level[1] + BLUR_MORE; v++) {
        if (v < 0 || v >= VS_WORDS_BLURS)
            continue;
        vs_sums_rows(w, s->cell, v, lines);
        for (u = level[0] - BLUR_LESS; u <= level[0] + BLUR_MORE; u++) {
            if (u >= 0 && u < VS_WORDS_BLURS)
                try_blur(w, s, u, v, (const vs_line *)lines, list);
        }
    }
}

/* Reads with or without the white around. */
static void read_cells(const struct vs_words *w, const float *cells, const int32_t level[2],
                       int ring, struct vs_reading *reading)
{
    struct shortlist list;
    struct seen s;
    int row, k, best = 0;

    s.span = w->cells + 4;
    s.ring = ring;
    memset(s.cell, 0, sizeof s.cell);
    for (row = 0; row < s.span; row++)
        memcpy(s.cell[row], cells + row * s.span, (size_t)s.span * sizeof cells[0]);
    flatten(&s);
    list_words(w, &s, level[0], level[1], &list);
    if (list.count == 0 || !((double)list.likeness[0] > LEAST_START))
        return;
    try_blurs(w, &s, level, &list);
    for (k = 1; k < list.count; k++)
        best = list.likeness[k] > list.likeness[best] ? k : best;
    reading->tag = list.word[best] / 4;
    reading->turn = list.word[best] % 4;
    judge(w, &s, &list, best, reading);
}

static void read_one(const struct vs_words *w, const float *cells, const int32_t level[2],
                     struct vs_reading *reading)
{
    int ring;

    for (ring = 1; ring >= 0; ring--) {
        *reading = (struct vs_reading){1.0, 1.0, -1, 0, 0};
        read_cells(w, cells, level, ring, reading);
        if (reading->sure)
            return;
    }
}

void vs_words_read(const struct vs_words *words, const float *cells, const int32_t *level,
                   size_t count, struct vs_reading *readings)
{
    int span = words->cells + 4;
    size_t i;

    for (i = 0; i < count; i++)
        read_one(words, cells + i * (size_t)(span * span), level + 2 * i, &readings[i]);
}
