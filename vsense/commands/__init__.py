"""The commands of `vsense`: one module each, with HELP, DESCRIPTION, add_arguments and run."""
