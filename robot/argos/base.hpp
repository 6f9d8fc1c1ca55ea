/* SPDX-License-Identifier: MIT */
/*
 * base.hpp - what ARGoS's controllers and loop functions share: numbers, text, maths, random
 * numbers, settings and the log.
 */
#ifndef VS_ARGOS_BASE_HPP
#define VS_ARGOS_BASE_HPP

#include "angles.hpp"
#include "any.hpp"
#include "byte_array.hpp"
#include "color.hpp"
#include "configuration.hpp"
#include "exception.hpp"
#include "log.hpp"
#include "quaternion.hpp"
#include "random.hpp"
#include "rays.hpp"
#include "text.hpp"
#include "types.hpp"
#include "vectors.hpp"

#endif
