"""`vsense optimize`: the settings of an experiment that are best by its measures."""

from __future__ import annotations

import argparse
import json

from vsense.base.terminal import Console, print_data
from vsense.commands import _arguments, compare
from vsense.studies.series.optimize import BATCH, RUNS, TRIALS, optimize

DESCRIPTION = (
    "Searches for the settings of an experiment that are best by its measures, with Optuna. A trial"
    " is some simulated runs, the same seeds in every trial, and counts by their mean. Several"
    " --maximize and --minimize are searched for at once: the trials that no other one beats are"
    " printed. Ctrl-C keeps what is there; the same command goes on, and with more --trials it adds"
    " to it."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    _arguments.add_experiment_name(parser)
    text = (
        "a setting, as in --set, and where it may lie: 0..1, in steps 0..1:0.1 or 5..20:1, by"
        " its logarithm 0.001..1:log; or choices: a,b,c. What takes whole numbers only is given no"
        " others. Several --vary: all together"
    )
    _arguments.repeated(
        parser, "--vary", _arguments.setting, "ELEMENT.ATTRIBUTE=LOW..HIGH", text, required=True
    )
    for option, word in (("--maximize", "more"), ("--minimize", "less")):
        text = f"a measure, of which {word} is better; may be given again"
        _arguments.repeated(parser, option, str, "MEASURE", text)
    text = f"runs of every trial (default: {RUNS})"
    _arguments.option(parser, "--runs", _arguments.positive, "N", text, RUNS)
    text = f"trials, with those that are there already (default: {TRIALS})"
    _arguments.option(parser, "--trials", _arguments.positive, "N", text, TRIALS)
    text = f"trials that are chosen at a time: more keep a cluster busy (default: {BATCH})"
    _arguments.option(parser, "--batch", _arguments.positive, "N", text, BATCH)
    compare.add_trials(parser)


def run(options: argparse.Namespace) -> int:
    """Searches; 0, or 130 after Ctrl-C, 143 after SIGTERM."""
    found = optimize(
        options.experiment,
        compare.once("--vary", options.vary),
        maximize=options.maximize,
        minimize=options.minimize,
        runs=options.runs,
        trials=options.trials,
        batch=options.batch,
        **compare.trials_of(options),
    )
    for line in (f"best of {len(found.trials)} trials:", *found.lines()):
        Console().say(line)
    compare.say_files(found.table, found.picture)
    if options.json:
        print_data(json.dumps(found.facts(), indent=2))
    return 0
