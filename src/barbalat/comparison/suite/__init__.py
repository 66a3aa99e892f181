"""A frozen public suite of design problems, on which anybody's controller is measured by one rule."""
