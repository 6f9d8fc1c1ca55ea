"""The control room: a page that shows a run and takes orders for it. README.md beside this file."""
