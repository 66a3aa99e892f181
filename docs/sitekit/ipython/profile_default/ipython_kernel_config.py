"""How the site's notebooks store figures, and what commands in their cells see."""

c = get_config()  # type: ignore[name-defined]  # noqa: F821
c.InlineBackend.figure_formats = {"retina"}  # twice a screen's pixels
c.IPKernelApp.log_level = "ERROR"  # that a kernel listens on this machine alone needs no warning
c.IPKernelApp.exec_lines = [  # plain text, 80 columns wide
    "import os",
    "os.environ.pop('FORCE_COLOR', None)",
    "os.environ['COLUMNS'] = '80'",
    "del os",
]
