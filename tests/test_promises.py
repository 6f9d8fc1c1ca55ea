"""What SECURITY.md promises and which ports PORTS.md has, each with the tests that attack it.

A promise or a port without an attack, and a test that is gone, fail here.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LINK = ROOT / "vsense" / "robots" / "link"

Tests = tuple[str, ...]
ATTACKS, LAB = "robots/link/test_attacks.py::test_", "system/test_attacked_lab.py::test_"
FAULTS, KEYS = "robots/link/test_faults.py::test_", "robots/test_robot_keys.py::test_"
PRINT, UI = "base/test_printable.py::test_", "monitor/ui/test_"
PACKAGES, FUZZ = "studies/packages/test_packages.py::test_", "fuzz/test_bounds.py::test_"
ACCOUNTS = (
    "system/test_two_accounts.py::test_one_member_stops_the_others_run_and_a_stranger_does_not"
)
NODES = "vision/tracking/test_node_attacks.py::test_"
KEY_SEARCH, RIG = "system/test_key_search.py::test_", "faults/test_faults.py::test_"
SEARCH = f"{KEY_SEARCH}in_a_"

PROMISES: Mapping[str, Tests] = {
    "Nobody without the key": (
        f"{ATTACKS}nothing_that_is_made_up_moves_the_robot",
        f"{ATTACKS}nothing_that_is_made_up_is_believed_by_the_host",
        f"{ATTACKS}nobody_takes_a_place_before_the_robot_comes",
        f"{LAB}with_keys_an_attack_changes_nothing",
        "robots/test_keys.py::test_a_robot_with_a_key_obeys_nobody_else",
        "wire/test_tag.py::test_official_vectors",
    ),
    "A greeting changes nothing": (
        f"{ATTACKS}a_greeting_that_was_heard_opens_nothing",
        f"{ATTACKS}a_goodbye_without_the_key_ends_nothing",
        f"{ATTACKS}a_host_without_the_key_changes_nothing_at_the_robot",
    ),
    "Nothing that was heard counts twice": (
        f"{ATTACKS}what_was_heard_changes_nothing_when_it_comes_again",
        f"{ATTACKS}what_comes_again_to_a_host_that_hears_renews_nothing",
        "wire/test_session.py::test_no_packet_can_be_so_far_ahead_that_all_others_are_old",
    ),
    "After STOP": (f"{ATTACKS}stop_comes_both_ways_and_nothing_older_starts_again",),
    "A robot that does not stop": (
        "run/test_obedience.py::test_what_it_reports_counts_after_150_ms",
        "run/test_obedience.py::test_a_robot_that_is_seen_moving_is_told_whatever_it_says",
        f"{LAB}without_keys_the_host_says_what_happens",
    ),
    "Wheels stop without": (
        "robots/test_faults.py::test_silent_host",
        "robots/test_faults.py::test_controller_that_hangs_or_crashes_stops_the_wheels",
        f"{RIG}six_faults_break_no_promise",
    ),
    "A greeting that was heard keeps": (
        f"{ATTACKS}a_repeated_greeting_pushes_no_robot_out",
        f"{ATTACKS}a_copy_that_arrives_before_the_greeting_keeps_no_robot_out",
    ),
    "Strangers cost the robots": (
        "system/test_flooded_lab.py::test_strangers_on_two_ports_cost_nobody_anything",
        f"{FAULTS}a_crowd_from_many_addresses_cannot_keep_a_robot_out",
        f"{UI}web_listener.py::test_who_has_shown_a_token_is_not_thrown_out_by_strangers",
    ),
    "Nobody hears the page's tokens": (
        f"{UI}https.py::test_tokens_leave_the_machine_encrypted",
        f"{UI}https.py::test_another_start_has_the_same_certificate",
    ),
    "What comes from the network or from a file": (
        f"{PRINT}whatever_comes_is_safe_and_the_rest_is_as_it_was",
        f"{PRINT}the_wire_refuses_what_is_escaped_here",
        "commands/test_hostile_texts.py::test_no_file_speaks_to_the_terminal",
        "test_house.py::test_texts_of_files_are_printed_in_one_place",
    ),
    "Files made to hurt": (f"{FUZZ}a_reader_is_bounded",),
    "Somebody's package": (
        f"{PACKAGES}code_of_others_is_run_only_for_who_trusts_it_and_results_are_compared",
        f"{PACKAGES}nothing_but_a_shipped_experiment_is_vsenses_own",
    ),
    "What lies in the current folder": (
        "system/test_current_folder.py::test_what_is_started_imports_nothing_from_there",
        "system/test_current_folder.py::test_of_every_process_nothing_is_imported_from_there",
    ),
    "A stolen robot betrays": (
        f"{KEYS}each_robot_gets_its_own_and_keeps_its_uid",
        f"{SEARCH}lab_no_code_of_users_finds_the_swarms_key",
    ),
    "Keys and tokens": (f"{KEY_SEARCH}keys_and_tokens_are_in_private_files_only",),
    "No controller, loop function or sensor": (
        f"{SEARCH}lab_no_code_of_users_finds_the_swarms_key",
        f"{SEARCH}run_no_code_of_users_finds_the_swarms_key",
        "robots/link/test_key_process.py::test_other_programs_of_its_account_cannot_look_into_it",
    ),
    "A former key": (
        f"{ATTACKS}a_robot_that_shows_the_key_before_the_one_it_was_brought_is_not_believed",
        f"{KEYS}a_robot_that_was_away_is_renewed_by_the_next_deploy_of_anything",
    ),
    "Accounts outside of the lab's group": (
        ACCOUNTS,
        "base/test_sharing.py::test_a_shared_file_follows_no_link_and_has_its_mode",
    ),
    "A controller on a robot does not become": (
        "robots/test_service.py::test_the_daemon_keeps_the_guards_capabilities_alone",
        "robots/test_service.py::test_systemd_calls_the_service_bounded",
    ),
    "Of what comes under the name of a camera's node": (
        f"{NODES}garbage_and_other_versions_are_refused_and_cost_nothing_else",
        f"{NODES}rows_that_were_heard_count_once",
        f"{NODES}rows_of_other_times_and_sessions_are_refused",
        f"{NODES}a_node_that_nobody_has_listed_gives_nothing",
        f"{NODES}expectations_that_no_tracker_has_do_not_end_a_node",
        f"{NODES}an_events_text_is_one_line_that_controls_nothing",
        "vision/tracking/test_node_rows.py::test_any_bytes_are_rows_or_one_error",
        "vision/tracking/test_node_rows.py::"
        "test_tags_of_no_roster_are_where_the_picture_shows_them",
    ),
    "With certificates only nodes": (
        f"{NODES}the_pages_certificates_let_the_labs_nodes_in_and_nobody_else",
    ),
    "No dependency has a known advisory": (
        "packaging/test_release.py::test_it_works_at_exactly_its_lower_bounds",
    ),
}
"""Each row of SECURITY.md by its first words."""

PORTS: Mapping[str, tuple[str, Tests]] = {
    "robots": ("robots/link/server", (f"{LAB}with_keys_an_attack_changes_nothing",)),
    "the page": (
        "monitor/ui/_server",
        (ACCOUNTS, f"{UI}server.py::test_a_page_from_elsewhere_is_refused"),
    ),
    "Foxglove": (
        "monitor/ui/_foxglove_process",
        (f"{UI}foxglove_server.py::test_nothing_can_be_said_to_it",),
    ),
    "JSON lines": (
        "robots/link/trackers/lines",
        (
            "robots/link/test_arena_lines.py::test_only_valid_lines_hold_the_place",
            "robots/link/test_arena_lines.py::test_a_tracker_that_turns_to_garbage_loses_its_place",
        ),
    ),
    "the original's clients": (
        "robots/link/_listening",
        (
            "robots/link/test_legacy_server.py::test_strangers_are_turned_away",
            "robots/link/test_legacy_server.py::"
            "test_a_place_is_taken_from_nobody_at_another_address",
        ),
    ),
    "`vsense camera serve`": (
        "robots/link/_listening",
        ("robots/link/test_arena_server.py::test_a_peer_that_is_no_client_is_let_go",),
    ),
    "a tracker at `ats_host`": (
        "",
        (
            "robots/link/test_arena_client.py::"
            "test_defect_7_bytes_that_are_no_state_cost_the_connection_only",
            "robots/link/test_arena_client.py::test_defect_1_a_state_in_single_bytes_is_whole",
        ),
    ),
    "nodes of cameras": (
        "",  # Zenoh listens
        (f"{NODES}the_pages_certificates_let_the_labs_nodes_in_and_nobody_else",),
    ),
    "motion capture": (
        "",
        (
            "robots/link/test_mocap.py::test_the_librarys_own_mock_system",
            "robots/link/test_mocap.py::"
            "test_bodies_of_optitrack_vanish_come_back_and_change_their_order",
        ),
    ),
    "DDS": (
        "",
        (f"{UI}ros2_publisher.py::test_a_run_goes_on_where_the_process_that_publishes_is_killed",),
    ),
    "GigE cameras": (
        "",
        (
            "tools/camera_setup/test_fake_camera.py::"
            "test_what_strangers_send_to_a_cameras_ports_is_no_picture",
        ),
    ),
    "`vsense control status`": (
        "monitor/ui/control_socket",
        (ACCOUNTS, f"{UI}control_socket.py::test_the_folder_is_for_this_user_alone"),
    ),
}
"""Each row of PORTS.md by its first words: the module that listens, and its attacks. "": vsense
connects to what sends."""

NO_ROBOTS = {
    "modes/lab/_links": "emulated boards, in a folder of the run",
    "modes/lab/network_cameras": "rendered pictures, for this machine alone",
    "modes/live/opening": "looks whether a port is free",
    "monitor/ui/_foxglove_server": "looks whether a port is free",
    "robots/link/network": "what the others open ports with",
    "tools/doctor/checks": "looks whether a port is free",
    "tools/camera_setup/aligning": "camera files, before a run",
    "vision/cameras/_networks": "who is there, before a run",
}
"""Modules that listen, and nothing that they hear moves a robot."""

_LISTENS = re.compile(
    r"(?<!def )(?<!signature\(hook\)\.)\b(?:listen|bind|start_server)\("
    r"|\bThreading(?:HTTP|UnixStream)Server\b"
)


def rows(page: str, head: str) -> list[str]:
    """The first cells of a table of a page."""
    table = (LINK / page).read_text().partition(head)[2].partition("\n\n")[0]
    return re.findall(r"^\| ([^|]+?) \|", table, re.M)[1:]


def missing(found: Iterable[str], known: Iterable[str]) -> tuple[set[str], set[str]]:
    """Rows that no key begins, and keys that begin no row or several."""
    found, known = list(found), list(known)
    begun = {key: [row for row in found if row.startswith(key)] for key in known}
    held = {row for matches in begun.values() for row in matches}
    return set(found) - held, {key for key, matches in begun.items() if len(matches) != 1}


def test_every_promise_has_an_attack() -> None:
    assert missing(rows("SECURITY.md", "| promise | how |"), PROMISES) == (set(), set())


def test_every_port_has_an_attack() -> None:
    head = "| port | opened by | listens on | who is believed |"
    assert missing(rows("PORTS.md", head), PORTS) == (set(), set())


def test_every_module_that_listens_is_a_port() -> None:
    listens = {
        str(path.relative_to(ROOT / "vsense").with_suffix(""))
        for path in (ROOT / "vsense").rglob("*.py")
        if _LISTENS.search(path.read_text())
    }
    assert listens == NO_ROBOTS.keys() | {module for module, _ in PORTS.values()} - {""}


@pytest.mark.parametrize("name", [*PROMISES, *PORTS])
def test_the_attacks_are_there(name: str) -> None:
    tests = PROMISES[name] if name in PROMISES else PORTS[name][1]
    assert tests
    for test in tests:
        file, _, function = test.partition("::")
        tree = ast.parse((ROOT / "tests" / file).read_text())
        assert function in {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}, test
