-- Reads and sets everything, and notes it: see SOURCE.md.

local out, now = nil, 0

local function note(name, ...)
   local words = {name}
   for i = 1, select("#", ...) do words[i + 1] = string.format("%.10g", (select(i, ...))) end
   out:write(table.concat(words, " "), "\n")
end

local function ring(name)
   if robot[name] == nil then return 0 end
   local values, angles, sum = {}, {}, 0
   for i, reading in ipairs(robot[name]) do
      values[i] = type(reading) == "table" and reading.value or reading
      if type(reading) == "table" then angles[i] = reading.angle or reading.offset.x end
      sum = sum + values[i] * (i <= #robot[name] / 2 and 1 or -1)
   end
   note(name, table.unpack(values))
   if #angles > 0 and (#angles < 24 or now == 0) then note(name .. ".angle", table.unpack(angles)) end
   return sum
end

local function ground()
   local below = robot.ground
   if below == nil then return 1 end
   if below.center then note("ground", below.left, below.center, below.right) return below.center end
   note("ground", table.unpack(below))
   return below[2]
end

-- What a Pi-Puck has.
local function around()
   local far, grey, sum = {}, {}, 0
   for i, finder in ipairs(robot.rangefinders or {}) do
      far[i] = finder.proximity
      sum = sum + (0.1 - far[i]) * (i > 4 and 50 or -50)
   end
   for i, below in ipairs(robot.ground_sensors or {}) do grey[i] = below.reflected end
   if #far > 0 then note("rangefinders", table.unpack(far)) end
   if #grey > 0 then note("ground_sensors", table.unpack(grey)) end
   if robot.system then note("system", robot.system.time, robot.system.temperature) end
   return sum
end

local function heard()
   local all = {}
   if robot.range_and_bearing == nil then return 0 end
   for _, message in ipairs(robot.range_and_bearing) do
      local bytes = message.data
      all[#all + 1] = {bytes[1], bytes[2], message.range,
                       message.bearing or message.horizontal_bearing, bytes[3], bytes[4]}
   end
   table.sort(all, function(a, b) return a[1] * 256 + a[2] < b[1] * 256 + b[2] end)
   for _, message in ipairs(all) do note("heard", table.unpack(message)) end
   return #all
end

local function seen()
   if robot.colored_blob_omnidirectional_camera == nil then return 0 end
   local all = {}
   for i, blob in ipairs(robot.colored_blob_omnidirectional_camera) do
      local color = blob.color
      all[i] = {blob.distance, blob.angle, color.red, color.green, color.blue}
   end
   table.sort(all, function(a, b) return a[1] < b[1] end)
   for _, blob in ipairs(all) do note("seen", table.unpack(blob)) end
   return #all
end

local function shine(blobs)
   local bright = 25 * (now % 10)
   if robot.leds and robot.leds.set_ring_leds then
      robot.leds.set_ring_leds(now % 4 < 2)
      robot.leds.set_ring_led_index(1 + now % 8, true)
      robot.leds.set_body_led(now % 3 == 0)
   elseif robot.leds then
      robot.leds.set_all_colors(now % 20 < 10 and "cyan" or "black")
      robot.leds.set_single_color(1 + now % 8, bright, 0, 255 - bright)
      robot.leds.set_single_color(8, "orange")
      if #robot.proximity == 24 then robot.leds.set_single_color(13, "green") end
   end
   if robot.overo_leds then robot.overo_leds.set_single_color(1 + now % 3, bright, 200, blobs % 256) end
   if robot.base_leds then
      robot.base_leds.switch_leds(now % 30 >= 15)
      robot.base_leds.switch_led(1 + now % 8, true)
   end
end

function init()
   out = io.open(robot.params.folder .. "/" .. robot.id .. ".txt", "w")
   if robot.colored_blob_omnidirectional_camera then
      robot.colored_blob_omnidirectional_camera.enable()
   end
   number = tonumber(robot.id:match("%d+$")) + (robot.leds and 10 or 0)
end

function step()
   local place = robot.positioning
   local yaw = place.orientation:toeulerangles()
   note("step", now, place.position.x, place.position.y, yaw)
   ring("base_ground")
   local turn = 3 * ring("proximity") - ring("light") + 0.1 * ring("motor_ground") + around()
   local speed = 2 + 6 * ground() + 0.1 * heard() - 0.01 * seen()
   shine(now)
   local bytes = {number, now % 256, math.floor(100 * speed) % 256, 7}
   if robot.range_and_bearing then robot.range_and_bearing.set_data(bytes) end
   local left, right = speed - turn, speed + turn
   if robot.wheels then robot.wheels.set_velocity(left, right)
   else robot.differential_drive.set_linear_velocity(0.01 * left, 0.01 * right) end
   note("wheels", left, right)
   now = now + 1
end

function reset() end

function destroy() out:close() end
