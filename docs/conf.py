"""Settings of the site that ``./dev docs`` builds: its code runs and its pictures are made while it is built."""

from __future__ import annotations

import os
import shutil
import sys
import sysconfig
import tempfile
from pathlib import Path

import barbalat

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
kernels = tempfile.TemporaryDirectory()  # IPython writes beside its settings
shutil.copytree(HERE / "sitekit" / "ipython", kernels.name, dirs_exist_ok=True)
os.environ["IPYTHONDIR"] = kernels.name
reproduction = tempfile.TemporaryDirectory()  # the ledger's page measures into it, and the site keeps a copy
os.environ.setdefault("BARBALAT_REPRODUCTION", reproduction.name)  # CI has measured already, and names its report
os.environ.pop("MPLBACKEND", None)  # notebooks show their pictures, whatever a shell says of windows
os.environ["PATH"] = os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]])  # where the command barbalat is

project = "Barbalat"
version = release = barbalat.__version__
language = "en"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx_argparse_cli",
    "sphinx_gallery.gen_gallery",
    "sitekit.mathematics",
    "sitekit.reference",
    "sitekit.finished",
]
exclude_patterns = ["_build", "sitekit", "gallery/*.ipynb", "gallery/*.py", "gallery/*.md5"]

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

nb_execution_in_temp = True  # what a cell writes does not land among the pages
nb_execution_mode = "force"  # nothing is taken from an earlier build
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_execution_timeout = 600  # [s]; a busy machine takes several times as long as an idle one
nb_output_stderr = "error"
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_use_type_comments = False
autodoc_type_aliases = {name: name for name in ("Array", "Gain", "Matrix", "Value", "Vector")}
python_maximum_signature_line_length = 88

sphinx_gallery_conf = {
    "examples_dirs": str(HERE.parent / "examples" / "gallery"),
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "abort_on_example_error": True,
    "run_stale_examples": True,
    "capture_repr": (),
    "image_srcset": ["2x"],
    "remove_config_comments": True,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 60,
    "write_computation_times": False,
    "download_all_examples": False,
    "within_subsection_order": "FileNameSortKey",
    "parallel": min(os.cpu_count() or 1, 8),
}

html_theme = "furo"
html_math_renderer = "mathml"
html_title = "Barbalat"
html_static_path = ["sitekit/static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_copyright = False
html_show_sourcelink = False
html_permalinks_icon = "#"
html_theme_options = {"navigation_with_keys": False}
