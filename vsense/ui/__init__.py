"""The control room: what happens in a run, told to whoever looks, and people's orders.

The control room: a page that shows a run and takes orders for it. README.md beside this file.
"""
