#include "options.h"

/* Alone in a file: all others are the same for every controller, and are compiled once. */
#ifndef VSENSED_CONTROLLER_HASH
#define VSENSED_CONTROLLER_HASH ""
#endif

#ifndef VSENSED_SOURCES
#define VSENSED_SOURCES ""
#endif

const char vsensed_version[VS_NAME_MAX + 1] = VSENSED_VERSION VSENSED_SOURCES;
const char vsensed_controller_hash[VS_NAME_MAX + 1] = VSENSED_CONTROLLER_HASH;
