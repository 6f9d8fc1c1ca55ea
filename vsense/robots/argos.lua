-- SPDX-License-Identifier: MIT
-- The `robot` table of ARGoS's Lua controllers, over the numbers that vsense has of a robot.
--
-- Run once for each robot, in a state of its own. Values come as a string of doubles in the order of
-- the sensors, and what the robot does goes back as one, in the order of the actuators.
-- Sources of names, units and errors: argos3 421bd76, core/wrappers/lua and the CreateLuaState of
-- plugins/robots/generic and foot-bot; argos3-epuck 66cb8d9, control_interface.

local ask, say_line, id, params, sensors, actuators, seed, axle_cm = ...
local unpack, pack, format, floor = string.unpack, string.pack, string.format, math.floor
local getinfo, sethook, pcall, type = debug.getinfo, debug.sethook, pcall, type

robot = {id = id}
python = nil

-- Checks as ARGoS's functions make them; the error is at the line of the script that called.

local function check(value, number, name, wanted, level)
   if type(value) ~= wanted then
      local words = "bad argument #%d to '%s' (%s expected, got %s)"
      local got = value == nil and "no value" or type(value)
      error(format(words, number, name, wanted, got), level or 3)
   end
end

local function count(given, words, ...)
   for _, wanted in ipairs({...}) do
      if given == wanted then return end
   end
   error(words, 3)
end

local function place(i, number)
   i = floor(i)
   if i < 1 or i > number then
      error(format("passed index %d out of bounds [1,%d]", i, number), 3)
   end
   return i
end

local function single(value) return (unpack("f", pack("f", value))) end

local function byte(value) return floor(value) % 256 + 0.0 end

local function part(name)
   robot[name] = robot[name] or {}
   return robot[name]
end

-- Vectors and quaternions

local function class(name, keys)
   local letters, methods = {}, {}
   for letter in keys:gmatch("%a") do letters[#letters + 1] = letter end
   local meta = {__name = name, __index = methods}
   local function each(f, a, b)
      local new = {}
      for _, key in ipairs(letters) do new[key] = f(a[key], b and b[key]) end
      return setmetatable(new, meta)
   end
   local function made(...)
      local new = {}
      for i, key in ipairs(letters) do new[key] = (select(i, ...)) + 0.0 end
      return setmetatable(new, meta)
   end
   function meta.__newindex() error("invalid operation on " .. name, 2) end
   function meta.__eq(a, b)
      for _, key in ipairs(letters) do
         if a[key] ~= b[key] then return false end
      end
      return true
   end
   function methods.length(a)
      local sum = 0.0
      for _, key in ipairs(letters) do sum = sum + a[key] * a[key] end
      return math.sqrt(sum)
   end
   function methods.normalize(a)
      local length = methods.length(a)
      for _, key in ipairs(letters) do a[key] = a[key] / length end
      return a
   end
   return methods, meta, each, made
end

local function vector(name, keys)
   local methods, meta, each, made = class(name, keys)
   function meta.__add(a, b) return each(function(x, y) return x + y end, a, b) end
   function meta.__sub(a, b) return each(function(x, y) return x - y end, a, b) end
   function meta.__unm(a) return each(function(x) return -x end, a) end
   function meta.__mul(a, b)
      local factor, of = a, b
      if type(b) == "number" then factor, of = b, a end
      if type(factor) ~= "number" then error("invalid arguments for multiplication by scalar", 2) end
      return each(function(x) return x * factor end, of)
   end
   function meta.__tostring(a)
      local said = keys:gsub("%a", function(key) return format("%g,", a[key]) end)
      return said:sub(1, -2)
   end
   function methods.dot(a, b)
      local sum = 0.0
      for key in keys:gmatch("%a") do sum = sum + a[key] * b[key] end
      return sum
   end
   return methods, function(...)
      local given = select("#", ...)
      if given == 0 then return made(0, 0, 0) end
      if given == 1 then return each(function(x) return x end, (...)) end
      count(given, "invalid arguments to " .. name, #keys)
      return made(...)
   end
end

local flat, spatial, turning, meta, made, _
flat, vector2 = vector("vector2", "xy")
spatial, vector3 = vector("vector3", "xyz")
turning, meta, _, made = class("quaternion", "wxyz")

function quaternion(...)
   local given, first, second = select("#", ...), ...
   if given == 0 then return made(1, 0, 0, 0) end
   if given == 1 then return made(first.w, first.x, first.y, first.z) end
   if given == 2 then
      local s = math.sin(first * 0.5)
      return made(math.cos(first * 0.5), second.x * s, second.y * s, second.z * s)
   end
   count(given, "invalid arguments to quaternion", 4)
   return made(...)
end

function meta.__mul(a, b)
   return made(a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
               a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
               a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
               a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w)
end

function meta.__tostring(q)
   local z, y, x = q:toeulerangles()
   return format("%g,%g,%g", math.deg(z), math.deg(y), math.deg(x))
end

function turning.inverse(q) return made(q.w, -q.x, -q.y, -q.z) end

function turning.toangleaxis(q)
   local axis = vector3(q.x, q.y, q.z)
   if axis:length() == 0 then return 0.0, vector3(0, 0, 1) end
   return 2 * math.acos(q.w), axis:normalize()
end

function turning.toeulerangles(q)
   local w, x, y, z = q.w, q.x, q.y, q.z
   local pitch = x * z + w * y
   if math.abs(pitch) > single(0.49999) then
      local up = pitch > 0 and math.pi / 2 or -math.pi / 2
      return math.atan(2 * (x * y + w * z), 1 - 2 * (x * x + z * z)), up, 0.0
   end
   return math.atan(2 * (w * z - x * y), w * w + x * x - y * y - z * z), math.asin(2 * pitch),
          math.atan(2 * (w * x - y * z), w * w - x * x - y * y + z * z)
end

function flat.cross(a) return a end -- as in ARGoS, whose product is lost

function flat.rotate(a, angle)
   local s, c = math.sin(angle), math.cos(angle)
   a.x, a.y = a.x * c - a.y * s, a.x * s + a.y * c
   return a
end

function spatial.cross(a, b)
   a.x, a.y, a.z = a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x
   return a
end

function spatial.rotate(a, turn)
   local turned = turn * made(0, a.x, a.y, a.z) * turn:inverse()
   a.x, a.y, a.z = turned.x, turned.y, turned.z
   return a
end

-- What Lua 5.3 of Debian and Ubuntu has kept of 5.2

math.atan2 = math.atan
function math.pow(x, y) return x ^ y end
function math.log10(x) return math.log(x, 10) end
function math.sinh(x) return (math.exp(x) - math.exp(-x)) / 2 end
function math.cosh(x) return (math.exp(x) + math.exp(-x)) / 2 end
function math.tanh(x) return 1 - 2 / (math.exp(2 * x) + 1) end
function math.ldexp(x, power) return x * 2.0 ^ power end

-- Random numbers: a generator of this robot's own, xorshift64*, so that a seed repeats a run

local bits = seed

local function uniform()
   bits = bits ~ bits >> 12
   bits = bits ~ bits << 25
   bits = bits ~ bits >> 27
   return (bits * 0x2545F4914F6CDD1D >> 11) * 2.0 ^ -53
end

local function normal()
   return math.sqrt(-2 * math.log(1 - uniform())) * math.cos(2 * math.pi * uniform())
end

local random = part("random")

function random.bernoulli(...)
   count(select("#", ...), "robot.random.bernoulli() expects 0 or 1 arguments", 0, 1)
   return uniform() < ((...) or 0.5)
end

function random.uniform(...)
   count(select("#", ...), "robot.random.uniform() expects 0, 1, or 2 arguments", 0, 1, 2)
   local low, high = ...
   if high == nil then low, high = 0, low or 1 end
   check(low, 1, "uniform", "number")
   check(high, 2, "uniform", "number")
   return low + uniform() * (high - low)
end

function random.uniform_int(...)
   count(select("#", ...), "robot.random.uniform_int() expects 1 or 2 arguments", 1, 2)
   local low, high = ...
   if high == nil then low, high = 0, low end
   check(low, 1, "uniform_int", "number")
   check(high, 2, "uniform_int", "number")
   low, high = floor(low), floor(high)
   return floor(low + uniform() * (high - low)) + 0.0
end

function random.exponential(...)
   count(select("#", ...), "robot.random.exponential() expects 1 argument", 1)
   check((...), 1, "exponential", "number")
   return -math.log(1 - uniform()) * (...)
end

function random.poisson(...)
   count(select("#", ...), "robot.random.poisson() expects 1 argument", 1)
   check((...), 1, "poisson", "number")
   local events, left = -1, (...)
   repeat
      events, left = events + 1, left + math.log(1 - uniform())
   until left < 0
   return events
end

function random.gaussian(...)
   count(select("#", ...), "robot.random.gaussian() expects 1 or 2 arguments", 1, 2)
   local deviation, mean = ...
   check(deviation, 1, "gaussian", "number")
   return (mean or 0) + normal() * deviation
end

function math.random(low, high)
   if low == nil then return uniform() end
   if high == nil then low, high = 1, low end
   check(low, 1, "random", "number")
   check(high, 2, "random", "number")
   if low > high then error("bad argument #2 to 'random' (interval is empty)", 2) end
   return floor(low) + floor(uniform() * (floor(high) - floor(low) + 1))
end

function math.randomseed(new) bits = floor(new) * 2 + 1 end

-- Sensors: each gets its values from place `at` on, and gives the place behind them

local function angles(number)
   local all = {}
   if number == 8 then
      local parts = {10.5884, 3.5999, 2, 1.2, 0.8571, 0.6667, 0.5806, 0.5247}
      for i, piece in ipairs(parts) do all[i] = math.pi / single(piece) end
      return all
   end
   for i = 1, number do
      local angle = math.pi / 12 * (i - 0.5)
      all[i] = angle > math.pi and angle - 2 * math.pi or angle
   end
   return all
end

local function numbers(name, number)
   local all = part(name)
   for i = 1, number do all[i] = 0.0 end
   return function(v, at)
      for i = 1, number do all[i] = v[at + i - 1] end
      return at + number
   end
end

local function with_value(all)
   local number = #all
   for i = 1, number do all[i].value = 0.0 end
   return function(v, at)
      for i = 1, number do all[i].value = v[at + i - 1] end
      return at + number
   end
end

local function ring(name, number)
   local all = part(name)
   for i, angle in ipairs(angles(number)) do all[i] = {angle = angle} end
   return with_value(all)
end

-- Evenly spaced from straight ahead, signed.
local function even_ring(name, number)
   local all = part(name)
   for i = 1, number do
      local angle = 2.0 * math.pi * (i - 1) / number
      all[i] = {angle = angle > math.pi and angle - 2.0 * math.pi or angle}
   end
   return with_value(all)
end

local OFFSETS = {
   motor_ground = {6.3, 1.16, -6.3, 1.16, -6.3, -1.16, 6.3, -1.16},
   base_ground = {8.0, 0.0, 4.2, 6.5, 0.0, 8.0, -4.2, 6.5, -8.0, 0.0, -4.2, -6.5, 0.0, -8.0, 4.2,
                  -6.5},
}

local function below(name, number)
   local all, offsets = part(name), OFFSETS[name]
   for i = 1, number do all[i] = {offset = vector2(offsets[2 * i - 1], offsets[2 * i])} end
   return with_value(all)
end

-- Keys of a table, a number each.
local function fields(name, keys, constants)
   local all = part(name)
   for key, value in pairs(constants or {}) do all[key] = value end
   for _, key in ipairs(keys) do all[key] = 0.0 end
   return function(v, at)
      for i, key in ipairs(keys) do all[key] = v[at + i - 1] end
      return at + #keys
   end
end

-- A list whose length comes first; `size` numbers each.
local function list(name, size, entry, is_on)
   local all = part(name)
   return function(v, at)
      local places, old = floor(v[at]), #all
      if is_on and not is_on() then return at + 1 + places * size end
      at = at + 1
      for i = 1, places do
         all[i] = entry(v, at)
         at = at + size
      end
      for i = old, places + 1, -1 do all[i] = nil end
      return at
   end
end

local function data(v, at, size)
   local bytes = {}
   for i = 1, size do bytes[i] = v[at + i - 1] end
   return bytes
end

local BUILD = {numbers = numbers, ring = ring, even_ring = even_ring, below = below}

function BUILD.ground(name) return fields(name, {"left", "center", "right"}) end
function BUILD.charge(name) return fields(name, {"value"}) end
function BUILD.battery(name) return fields(name, {"available_charge"}, {time_left = math.huge}) end

function BUILD.odometer(name)
   local keys = {"distance_left", "distance_right", "velocity_left", "velocity_right"}
   return fields(name, keys, {axis_length = axle_cm})
end

function BUILD.axled(name)
   return fields(name, {"distance_left", "distance_right"}, {axis_length = axle_cm})
end

-- Of the Pi-Puck: speeds in m/s, distances in m.

function BUILD.driven(name)
   local encoders = {left = 0.0, right = 0.0}
   part(name).encoders = encoders
   return function(v, at)
      encoders.left, encoders.right = 0.01 * v[at + 2], 0.01 * v[at + 3]
      return at + 4
   end
end

local function each_with(name, number, key, other, first)
   local all = part(name)
   for i = 1, number do all[i] = {[key] = first, [other] = 0.0} end
   return function(v, at)
      for i = 1, number do all[i][key] = v[at + i - 1] end
      return at + number
   end
end

function BUILD.ranges(name, number) return each_with(name, number, "proximity", "illuminance", 0.1) end
function BUILD.reflected(name, number)
   return each_with(name, number, "reflected", "background", 0.0)
end
function BUILD.system(name) return fields(name, {"time"}, {temperature = 0.0}) end

function BUILD.encoder(name)
   local wheels, keys = part(name), {"distance_left", "distance_right"}
   local update = fields("encoder", keys, {axis_length = single(0.053)})
   wheels.encoder, robot.encoder = robot.encoder, nil
   return update
end

function BUILD.positioning(name)
   local all = part(name)
   all.position, all.orientation = vector3(), quaternion()
   return function(v, at)
      all.position = vector3(v[at], v[at + 1], 0)
      all.orientation = quaternion(v[at + 2], vector3(0, 0, 1))
      return at + 3
   end
end

function BUILD.heard(name, size)
   return list(name, size, function(v, at)
      return {range = v[at], horizontal_bearing = v[at + 1], vertical_bearing = 0.0,
              data = data(v, at + 2, size - 2)}
   end)
end

function BUILD.epuck_heard(name, size)
   return list(name, size, function(v, at)
      return {range = v[at], bearing = v[at + 1], data = data(v, at + 2, size - 2)}
   end)
end

function BUILD.seen(name)
   local all, on = part(name), false
   function all.enable() on = true end
   function all.disable() on = false end
   return list(name, 5, function(v, at)
      local color = {red = v[at + 2], green = v[at + 3], blue = v[at + 4]}
      return {distance = v[at], angle = v[at + 1], color = color}
   end, function() return on end)
end

-- Actuators: each sets its numbers in `out` from behind place `at` on, and says how many it has

local out, does = {}, {}

function does.wheels(name, at)
   part(name).set_velocity = function(...)
      count(select("#", ...), "robot.wheels.set_velocity() expects 2 arguments", 2)
      local left, right = ...
      check(left, 1, "set_velocity", "number")
      check(right, 2, "set_velocity", "number")
      if left ~= left or right ~= right then
         error("robot.wheels.set_velocity(): a speed is no number (nan)", 2)
      end
      out[at + 1], out[at + 2] = left, right
   end
   return 2
end

function does.drives(name, at)
   part(name).set_linear_velocity = function(...)
      local here = "robot.differential_drive.set_linear_velocity()"
      count(select("#", ...), here .. " expects 2 arguments", 2)
      local left, right = ...
      check(left, 1, "set_linear_velocity", "number")
      check(right, 2, "set_linear_velocity", "number")
      if left ~= left or right ~= right then error(here .. ": a speed is no number (nan)", 2) end
      out[at + 1], out[at + 2] = left, right
   end
   return 2
end

function does.on_off(name, at, number)
   local lights, ring = part(name), number - 2
   local function setter(key, first, last)
      lights[key] = function(...)
         count(select("#", ...), "robot.leds." .. key .. "() expects 1 argument", 1)
         check((...), 1, key, "boolean")
         for i = first, last do out[at + i] = (...) and 1.0 or 0.0 end
      end
   end
   setter("set_ring_leds", 1, ring)
   setter("set_front_led", ring + 1, ring + 1)
   setter("set_body_led", number, number)
   function lights.set_ring_led_index(...)
      count(select("#", ...), "robot.leds.set_ring_led_index() expects 2 arguments", 2)
      local i, on = ...
      check(i, 1, "set_ring_led_index", "number")
      check(on, 2, "set_ring_led_index", "boolean")
      i = place(i, ring)
      out[at + i] = on and 1.0 or 0.0
   end
   return number
end

local COLORS = {
   black = {0, 0, 0}, white = {255, 255, 255}, red = {255, 0, 0}, green = {0, 255, 0},
   blue = {0, 0, 255}, magenta = {255, 0, 255}, cyan = {0, 255, 255}, yellow = {255, 255, 0},
   orange = {255, 140, 0}, brown = {165, 42, 42}, purple = {160, 32, 240},
}
for i, level in ipairs({26, 51, 77, 102, 128, 153, 179, 204, 229}) do
   COLORS["gray" .. i * 10] = {level, level, level}
end

local function color(first, name, ...)
   if select("#", ...) == 3 then
      local red, green, blue = ...
      check(red, first, name, "number", 4)
      check(green, first + 1, name, "number", 4)
      check(blue, first + 2, name, "number", 4)
      return byte(red), byte(green), byte(blue)
   end
   local text = ...
   check(text, first, name, "string", 4)
   local levels = COLORS[text] or {text:match("^%s*(%d+),%s*(%d+),%s*(%d+),%s*(%d+)%s*$")}
   for i = 1, 3 do
      if (tonumber(levels[i]) or 256) > 255 then error("'" .. text .. "' is no color", 3) end
   end
   return levels[1] + 0.0, levels[2] + 0.0, levels[3] + 0.0
end

function does.lights(name, at, number)
   local lights, here = part(name), "robot." .. name
   local function set(i, red, green, blue)
      local first = at + 3 * (i - 1)
      out[first + 1], out[first + 2], out[first + 3] = red, green, blue
   end
   function lights.set_single_color(...)
      count(select("#", ...), here .. ".set_single_color() expects 2 or 4 arguments", 2, 4)
      local i = ...
      check(i, 1, "set_single_color", "number")
      i = place(i, number)
      set(i, color(2, "set_single_color", select(2, ...)))
   end
   function lights.set_all_colors(...)
      count(select("#", ...), here .. ".set_all_colors() expects 1 or 3 arguments", 1, 3)
      local red, green, blue = color(1, "set_all_colors", ...)
      for i = 1, number do set(i, red, green, blue) end
   end
   return 3 * number
end

function does.switches(name, at, number)
   local lights = part(name)
   function lights.switch_led(...)
      count(select("#", ...), "robot.base_leds.switch_led() expects 2 arguments", 2)
      local i, on = ...
      check(i, 1, "switch_led", "number")
      check(on, 2, "switch_led", "boolean")
      i = place(i, number)
      out[at + i] = on and 1.0 or 0.0
   end
   function lights.switch_leds(...)
      count(select("#", ...), "robot.base_leds.switch_leds() expects 1 argument", 1)
      check((...), 1, "switch_leds", "boolean")
      for i = 1, number do out[at + i] = (...) and 1.0 or 0.0 end
   end
   return number
end

-- A message: how many bytes, and these.
local function say(at, bytes, size)
   if #bytes ~= size then
      local words = "robot.range_and_bearing.set_data(array) expects an array of %d numbers"
      error(format(words, size), 3)
   end
   for i, value in ipairs(bytes) do
      if type(value) ~= "number" then
         error(format("element #%d of the array is not a number", i), 3)
      end
   end
   out[at + 1] = size
   for i, value in ipairs(bytes) do out[at + 1 + i] = byte(value) end
end

function does.epuck_said(name, at, size)
   part(name).set_data = function(...)
      count(select("#", ...), "robot.range_and_bearing.set_data() expects one arguments", 1)
      check((...), 1, "set_data", "table")
      say(at, (...), size)
   end
   return 1 + size
end

function does.said(name, at, size)
   local saying = part(name)
   out[at + 1] = size
   function saying.set_data(...)
      local given, i, value = select("#", ...), ...
      local words = "robot.range_and_bearing.set_data() expects either one or two arguments"
      count(given, words, 1, 2)
      if given == 1 then
         check(i, 1, "set_data", "table")
         say(at, i, size)
         return
      end
      check(i, 1, "set_data", "number")
      check(value, 2, "set_data", "number")
      i = place(i, size)
      out[at + 1 + i] = byte(value)
   end
   function saying.clear_data(...)
      count(select("#", ...), "robot.range_and_bearing.clear_data() expects no arguments", 0)
      for i = 1, size do out[at + 1 + i] = 0.0 end
   end
   return 1 + size
end

-- A virtual actuator that ARGoS does not have.
function does.set(name, at, number)
   part(name).set = function(i, value)
      check(i, 1, "set", "number")
      check(value, 2, "set", "number")
      i = place(i, number)
      out[at + i] = value
   end
   return number
end

local places = 0
for how, name, number in actuators:gmatch("(%S+) (%S+) (%d+)\n") do
   local first = places
   places = places + does[how](name, first, tonumber(number))
   for i = first + 1, places do out[i] = out[i] or 0.0 end
end

local updates = {}
for how, name, number in sensors:gmatch("(%S+) (%S+) (%d+)\n") do
   updates[#updates + 1] = BUILD[how](name, tonumber(number))
end

if params ~= "" then
   robot.params = {}
   for key, value in params:gmatch("(.-)\0(.-)\0") do robot.params[key] = value end
end

function log(...)
   local words = {}
   for i = 1, select("#", ...) do
      local value = select(i, ...)
      local is = type(value)
      words[i] = is == "boolean" and (value and "1" or "0") or is == "number" and format("%g", value)
         or is == "string" and value or is
   end
   say_line(table.concat(words))
end

logerr = log

function print(...)
   local words = {...}
   for i = 1, select("#", ...) do words[i] = tostring(words[i]) end
   say_line(table.concat(words, "\t"))
end

function os.exit() error("os.exit() would end the program that runs all robots", 2) end

-- A script that does not return: every so many instructions the host may have it fail, and it does
-- so until nothing of the script is left to catch that.

local INSTRUCTIONS = 100000
local raised, call, watch

local function give_up()
   if getinfo(2, "f").func ~= call then error(raised[1], 0) end
   sethook(watch, "", INSTRUCTIONS)
end

function watch()
   if not raised then
      local goes_on, why = pcall(ask)
      if goes_on then return end
      local here = getinfo(2, "Sl")
      raised = {format("%s:%d: %s", here.short_src, here.currentline, tostring(why)), why}
   end
   sethook(give_up, "", 1)
   error(raised[1], 0)
end

local create = coroutine.create
function coroutine.create(f)
   local made = create(f)
   sethook(made, watch, "", INSTRUCTIONS)
   return made
end

function coroutine.wrap(f)
   local made = coroutine.create(f)
   return function(...)
      local given = table.pack(coroutine.resume(made, ...))
      if not given[1] then error(given[2], 0) end
      return table.unpack(given, 2, given.n)
   end
end

-- Each of the following gives what it is for, or nil, why not, and the host's own error.

function call(f)
   raised = nil
   local is_fine, why = pcall(f)
   if is_fine and not raised then return true end
   if type(why) ~= "string" and type(why) ~= "number" then
      why = "(error object is a " .. type(why) .. " value)"
   end
   return nil, raised and raised[1] or why, raised and raised[2]
end

-- Runs the script; gives the functions that it has made, each with the line where it begins.
local function run(text, name, folder)
   -- Lua would look in the current folder, too, where anything may lie.
   local function absolute(places) return ((";" .. places):gsub(";[^/;][^;]*", "")) end
   package.cpath = absolute(package.cpath)
   package.path = folder .. "/?.lua;" .. folder .. "/?/init.lua" .. absolute(package.path)
   sethook(watch, "", INSTRUCTIONS)
   local before, made = {}, {}
   for key in pairs(_G) do before[key] = true end
   local is_fine, why, host = call(load(text, "@" .. name))
   if not is_fine then return nil, why, host end
   for key, value in pairs(_G) do
      if not before[key] and type(key) == "string" and type(value) == "function" then
         made[#made + 1] = key .. " " .. getinfo(value, "S").linedefined
      end
   end
   return table.concat(made, "\n")
end

local function begin() return call(init) end

local formats = setmetatable({}, {__index = function(all, size)
   all[size] = ("d"):rep(size // 8)
   return all[size]
end})
local spread, OUT = table.unpack, ("d"):rep(places)

local function step(values)
   local v, at = {unpack(formats[#values], values)}, 1
   for i = 1, #updates do at = updates[i](v, at) end
   local is_fine, why, host = call(_G.step)
   if not is_fine then return nil, why, host end
   return pack(OUT, spread(out, 1, places))
end

local function finish()
   if destroy == nil then return true end
   return call(destroy)
end

return run, begin, step, finish
