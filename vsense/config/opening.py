"""Opens the experiment that a command line names: `--set`, `--dry`, `--strict` and `--seed`."""

from __future__ import annotations

import argparse
import secrets
from collections.abc import Mapping

from vsense.config.experiment import load
from vsense.config.specs import Experiment
from vsense.errors import VsenseError


def open_experiment(
    options: argparse.Namespace, settings: Mapping[str, str] | None = None
) -> Experiment | None:
    """Loads an experiment as the command line says.

    Args:
        options: `experiment`, `duration`, `dry` and `strict`; and `set` where settings are None.
        settings: values instead of the file's.

    Returns:
        The experiment; None where the command was only asked what it holds (`--dry`): that is
        on standard output then.

    Raises:
        UsageError: there is no such experiment, or a setting fits nothing in it.
        ConfigError: the file is wrong, or is not fully supported with `--strict`.
        VsenseError: nobody reads standard output.
    """
    if settings is None:
        settings = dict(options.set)
    experiment = load(options.experiment, options.duration, settings)
    if options.dry:
        _print(experiment.describe())
    if options.strict:
        experiment.refuse_warnings()
    return None if options.dry else experiment


def choose_seed(options: argparse.Namespace, experiment: Experiment) -> int:
    """Gives a run's seed: the command line's, else the file's; for 0 a fresh one."""
    seed = experiment.seed if options.seed is None else options.seed
    return int(seed) or secrets.randbelow(2**32 - 1) + 1


def _print(text: str) -> None:
    try:
        print(text, flush=True)
    except OSError as error:
        raise VsenseError(f"standard output: {error.strerror}") from None
