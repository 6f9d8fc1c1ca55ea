"""Settings of Sphinx for the site; `scripts/docs` calls it."""

from vsense import __version__

project = "vsense"
author = "the vsense authors"
version = release = __version__
language = "en"

extensions = ["myst_parser"]
myst_heading_anchors = 4
myst_linkify_fuzzy_links = False
# Whole lines that are shown, in JSON with "..." or in C with a hole, need not be complete programs.
suppress_warnings = ["misc.highlighting_failure"]
highlight_language = "text"
# "--runs" is two dashes.
smartquotes = False
nitpicky = True

html_theme = "furo"
html_title = f"vsense {__version__}"
html_static_path = ["style.css"]
html_css_files = ["style.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
# Fonts are the system's own: the pages ask no other machine for anything.
html_theme_options = {"top_of_page_buttons": []}
