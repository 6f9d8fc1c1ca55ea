"""Names that users of ARGoS write in experiment files and that we pass over with a warning.

A name that is neither here nor understood is taken for a misspelling and refused. Source: the
entities, devices, engines and media of ARGoS 3 and its e-puck plug-in, and IRIDIA's virtual
sensors.
"""

from __future__ import annotations

ENTITIES = (
    "camera_wall", "cylinder", "eye-bot", "floor", "foot-bot", "gripper", "kheperaiv", "kilobot",
    "light", "pipuck", "prototype", "spiri", "zone",
)  # fmt: skip
"""Children of <arena> and <entity>."""

EPUCK_SETTINGS = ("rab_data_size", "rab_range")
"""Attributes of <e-puck> that only a simulated one obeys."""

ROBOT_SENSORS = ("epuck_light", "epuck_proximity", "light", "proximity")
"""Sensors that every e-puck has: the real ones are read, so their simulation is not set up."""

ROBOT_ACTUATORS = (
    "differential_steering", "epuck_base_leds", "epuck_rgb_leds", "epuck_wheels", "leds",
)  # fmt: skip
"""Actuators that every e-puck has."""

SENSORS = (
    "base_ground", "battery", "colored_blob_omnidirectional_camera",
    "colored_blob_perspective_camera", "destination_virtual_sensor", "differential_steering",
    "epuck_accelerometer", "epuck_base_ground", "epuck_battery", "epuck_camera", "epuck_encoder",
    "epuck_ground", "epuck_omnidirectional_camera", "epuck_range_and_bearing",
    "epuck_virtual_camera", "eyebot_light", "eyebot_proximity", "footbot_base_ground",
    "footbot_distance_scanner", "footbot_gripper", "footbot_light", "footbot_motor_ground",
    "footbot_proximity", "footbot_turret_encoder", "footbot_wheel_speed", "gps_virtual_sensor",
    "ground", "positioning", "radios", "range_and_bearing",
    "virtual_black_white_location_sensor", "virtual_ground_sensor", "virtual_light_sensor",
    "virtual_radiation_sensor", "virtual_rgb_ground_sensor",
)  # fmt: skip
"""Children of <sensors>."""

ACTUATORS = (
    "epuck_range_and_bearing", "footbot_beacon", "footbot_gripper", "footbot_turret", "gripper",
    "magnets", "quadrotor_position", "quadrotor_speed", "radios", "range_and_bearing",
)  # fmt: skip
"""Children of <actuators>."""

SIMULATED_SETTINGS = (
    "calibrated", "check_occlusions", "data_size", "loss_probability", "medium", "noise_level",
    "noise_std_dev", "range", "show_rays",
)  # fmt: skip
"""Attributes of devices that only a simulated one obeys."""

PHYSICS_ENGINES = ("dynamics3d", "iridia_tracking_system", "pointmass3d", "static")
"""Children of <physics_engines> beside <dynamics2d>."""

MEDIA = ("directional_led", "led", "radio", "range_and_bearing", "simple_radio", "tag")
"""Children of <media>."""
