"""Aravis, the library behind GigE Vision and USB3 Vision cameras, opened when it is needed.

Only the three modules aravis* know it. Debian has it as libaravis-0.8-0.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import cffi

from vsense.base.errors import GrabberError
from vsense.base.terminal import printable
from vsense.vision.cameras._networks import GIGE_PROTOCOL, USB3_PROTOCOL, ListedCamera

ARAVIS_PACKAGE = "libaravis-0.8-0"

_DECLARATIONS = """
typedef struct { uint32_t domain; int code; char *message; } GError;
void g_error_free(GError *);
void g_free(void *);
void g_object_unref(void *);
void g_object_set(void *, const char *, ...);
void *g_inet_address_new_from_string(const char *);

void arv_update_device_list(void);
unsigned arv_get_n_devices(void);
const char *arv_get_device_id(unsigned);
const char *arv_get_device_physical_id(unsigned);
const char *arv_get_device_address(unsigned);
const char *arv_get_device_vendor(unsigned);
const char *arv_get_device_model(unsigned);
const char *arv_get_device_serial_nbr(unsigned);
const char *arv_get_device_protocol(unsigned);

void *arv_gv_device_new(void *interface, void *address, GError **);
void arv_gv_device_set_packet_size_adjustment(void *, int);
void arv_gv_device_set_stream_options(void *, int);
uint16_t arv_gv_stream_get_port(void *);
int arv_gv_device_is_controller(void *);
void *arv_camera_new(const char *, GError **);
void *arv_camera_new_with_device(void *, GError **);
void *arv_camera_get_device(void *);
int arv_camera_is_gv_device(void *);
void arv_camera_set_frame_rate(void *, double, GError **);
double arv_camera_get_frame_rate(void *, GError **);
void arv_camera_set_trigger(void *, const char *, GError **);
void arv_camera_clear_triggers(void *, GError **);
void arv_camera_software_trigger(void *, GError **);
const char **arv_camera_dup_available_pixel_formats_as_strings(void *, unsigned *, GError **);
unsigned arv_camera_gv_auto_packet_size(void *, GError **);
void arv_camera_gv_set_packet_size(void *, int, GError **);
unsigned arv_camera_gv_get_packet_size(void *, GError **);
void arv_camera_gv_set_packet_delay(void *, int64_t, GError **);
int64_t arv_camera_gv_get_packet_delay(void *, GError **);
unsigned arv_camera_get_payload(void *, GError **);
void arv_camera_start_acquisition(void *, GError **);
void arv_camera_stop_acquisition(void *, GError **);
void *arv_camera_create_stream(void *, void *, void *, GError **);

void arv_device_set_range_check_policy(void *, int);
int arv_device_read_register(void *, uint64_t, uint32_t *, GError **);
void *arv_device_get_feature(void *, const char *);
int arv_device_is_feature_available(void *, const char *, GError **);
void arv_device_get_integer_feature_bounds(void *, const char *, int64_t *, int64_t *, GError **);
void arv_device_get_float_feature_bounds(void *, const char *, double *, double *, GError **);
const char *arv_gc_feature_node_get_value_as_string(void *, GError **);
void arv_gc_feature_node_set_value_from_string(void *, const char *, GError **);

void *arv_buffer_new_allocate(size_t);
int arv_buffer_get_status(void *);
const void *arv_buffer_get_data(void *, size_t *);
int arv_buffer_get_image_width(void *);
int arv_buffer_get_image_height(void *);
unsigned arv_buffer_get_image_pixel_format(void *);
void arv_buffer_get_image_padding(void *, int *, int *);
uint64_t arv_buffer_get_timestamp(void *);
uint64_t arv_buffer_get_system_timestamp(void *);
void arv_stream_push_buffer(void *, void *);
void *arv_stream_timeout_pop_buffer(void *, uint64_t);
void arv_stream_get_n_buffers(void *, int *, int *);
int64_t g_get_real_time(void);
"""


_loading = threading.Lock()
"""All cameras' threads begin at once and must share the library's types."""


class AravisError(GrabberError):
    """Something that the library or a camera refuses."""


def load() -> SimpleNamespace:
    """Opens the library once; raises AravisError, which names its package, if it is missing."""
    with _loading:
        loaded = _load()
    if isinstance(loaded, str):
        raise AravisError(
            f"GigE and USB3 Vision cameras need the library Aravis ({loaded}):"
            f" apt-get install {ARAVIS_PACKAGE}"
        )
    return loaded


@cache
def _load() -> SimpleNamespace | str:
    """Returns the opened library, or the reason why it does not open."""
    ffi = cffi.FFI()
    ffi.cdef(_DECLARATIONS)
    try:
        # A library's handle looks into those that it was linked with: GLib's functions come along.
        lib = ffi.dlopen("libaravis-0.8.so.0")
        for function in re.findall(r"\b\w+(?=\()", _DECLARATIONS):
            getattr(lib, function)
    except OSError as error:
        # What ctypes tried besides helps nobody.
        return str(error).partition(".  Additionally")[0]
    except AttributeError as error:
        return f"0.8.23 or newer, this one is too old: {error}"
    return SimpleNamespace(ffi=ffi, lib=lib)


def call(function: Callable[..., Any], *arguments: object) -> Any:
    """Calls a function that ends with a GError; raises AravisError where it reports one."""
    ffi, lib = load().ffi, load().lib
    failure = ffi.new("GError **")
    result = function(*arguments, failure)
    if failure[0]:
        text = ffi.string(failure[0].message).decode(errors="replace")
        lib.g_error_free(failure[0])
        raise AravisError(text)
    return result


class _Question:
    """Looks for cameras once for all threads that ask at the same time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._begun = self._done = 0
        self._answer: list[ListedCamera] = []

    def ask(self) -> list[ListedCamera]:
        """Returns the cameras of a search that began after this call."""
        before = self._begun
        with self._lock:
            if self._done <= before:
                self._begun += 1
                # In a thread of its own, so that Ctrl-C does not interrupt the library.
                with ThreadPoolExecutor(1, "asking") as asker:
                    self._answer = asker.submit(_ask).result()
                self._done = self._begun
            return self._answer


_question = _Question()


def listed() -> list[ListedCamera]:
    """Searches the network and the USB for a second; raises AravisError without the library."""
    load()
    return _question.ask()


def _ask() -> list[ListedCamera]:
    ffi, lib = load().ffi, load().lib
    questions = (
        lib.arv_get_device_id,
        lib.arv_get_device_protocol,
        lib.arv_get_device_address,
        lib.arv_get_device_physical_id,
        lib.arv_get_device_vendor,
        lib.arv_get_device_model,
        lib.arv_get_device_serial_nbr,
    )
    lib.arv_update_device_list()
    rows = [[ask(n) for ask in questions] for n in range(lib.arv_get_n_devices())]
    texts = [[_text(ffi.string(t)) if t else "" for t in row] for row in rows]
    cameras = [ListedCamera(*row) for row in texts if row[1] in (GIGE_PROTOCOL, USB3_PROTOCOL)]
    # Aravis fills a USB3 camera's address with a word that is no address.
    cameras = [c if c.protocol == GIGE_PROTOCOL else replace(c, address="") for c in cameras]
    return sorted(cameras, key=lambda camera: (camera.protocol, camera.id))


def _text(field: bytes) -> str:
    return printable(field.decode(errors="replace"))
