/* SPDX-License-Identifier: MIT */
#include "vs_places.h"

#include "../vs_err.h"
#include "vs_math.h"
#include "vs_place.h"

int vs_destinations_read(const void *destinations, const struct vs_scene *scene,
                         double *readings)
{
    const struct vs_destinations *given = destinations;
    uint32_t i;

    for (i = 0; i < scene->robots; i++) {
        struct vs_place at = vs_place_of(scene, i);
        const double *place = given->places + 3 * (size_t)i;
        double *reading = readings + 5 * (size_t)i;
        int is_there = place[0] != place[0];
        double east_m, north_m;

        reading[0] = is_there ? at.x_m : place[0];
        reading[1] = is_there ? at.y_m : place[1];
        reading[2] = is_there ? at.yaw_rad : place[2];
        east_m = reading[0] - at.x_m;
        north_m = reading[1] - at.y_m;
        reading[3] = vs_root(east_m * east_m + north_m * north_m);
        reading[4] = 0.0;
        if (reading[3] > 0.0)
            reading[4] = vs_wrap_angle(vs_bearing(north_m, east_m) - at.yaw_rad);
    }
    return VS_OK;
}
