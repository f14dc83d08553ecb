"""A problem designed by hand in Jupyter: agents clicked, gains dragged, the exact verdict when the
hand rests.

Optional: needs the package anywidget (extra `notebook`), and Jupyter to be seen.
"""
