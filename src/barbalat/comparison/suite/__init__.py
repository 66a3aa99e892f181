"""A frozen public suite of design problems, on which any controller is measured by one rule."""
