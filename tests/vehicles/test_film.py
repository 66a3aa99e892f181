"""Scenes, films and paths in space for flights that are written here."""

import io

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image
from scipy.spatial.transform import Rotation

from barbalat.pictures.palette import COLOURS
from barbalat.pictures.render import render
from barbalat.vehicles import film as films
from barbalat.vehicles.film import film
from barbalat.vehicles.picture import frame, inside, paths_figure
from barbalat.vehicles.scene import Mover, Scene, attitudes

WIRE = (np.array([(1.0, 0, 0), (-1, 0, 0)]), np.array([(0, 1.0, 0), (0, -1, 0)]))
T = np.arange(0, 3, 0.05)


def circling(label, colour, radius, samples, lost=False):
    path = np.column_stack([radius * np.cos(T), radius * np.sin(T), 1 + 0.1 * T])[:samples]
    zero = np.zeros(len(path))
    return Mover(label=label, colour=colour, path=path, attitude=attitudes(zero, 10 + zero, np.rad2deg(T[:samples])), lost=lost)


def scene(**changed):
    movers = (circling("first", 0, 2.0, 30, lost=True), circling("second", 1, 1.0, 60))
    target = np.column_stack([np.cos(T), np.sin(T), 1 + 0.1 * T])
    known = {"title": "one is lost", "unit": "m", "t": T, "target": target, "movers": movers, "wire": WIRE, "fails": 1.0}
    return Scene(**known | changed)


def frames(gif):
    picture = Image.open(io.BytesIO(gif))
    found = []
    for k in range(picture.n_frames):
        picture.seek(k)
        found.append(np.asarray(picture.convert("RGB")).astype(int))
    return found


def pixels_of(picture, colour, top=130):
    """The pixels below the legend."""
    wanted = np.round(255 * np.array(to_rgb(COLOURS[colour])))
    return int((np.abs(picture[top:] - wanted).max(axis=2) <= 8).sum())


def test_a_film_shows_both_until_one_is_lost():
    gif = film(scene())
    assert Image.open(io.BytesIO(gif)).info["duration"] == 100
    found = frames(gif)
    assert len(found) == 30  # ten a second
    assert all(pixels_of(one, 1) > 20 for one in found)
    assert pixels_of(found[10], 0) == 0  # outside of the box, which is around the one that kept control
    assert 20 < pixels_of(found[-1], 0) < 40  # only the cross at the wall of the box


@pytest.mark.full
def test_a_film_is_the_same_again_and_has_fewer_frames_where_it_is_too_large(monkeypatch):
    whole = film(scene())
    assert whole == film(scene())  # the same bytes
    monkeypatch.setattr(films, "LARGEST_FILM_BYTES", len(whole) - 1)
    fewer = film(scene())
    assert len(fewer) < len(whole)
    assert Image.open(io.BytesIO(fewer)).n_frames == 15


@pytest.mark.full
def test_a_film_begins_shortly_before_the_failure(monkeypatch):
    monkeypatch.setattr(films, "SECONDS_BEFORE", 0.5)
    assert len(frames(film(scene(fails=2.0)))) == 15  # from 1.5 s on


def test_the_counter_says_how_long_ago_the_failure_came_which_may_have_passed():
    assert [films._told(scene(), k).split("\n")[0] for k in (18, 20, 50)] == [
        "0.9 s",
        "1.0 s, 0.0 s after the failure",
        "2.5 s, 1.5 s after the failure",
    ]
    assert films._told(scene(failing=False), 50).startswith("2.5 s\n")


def test_the_box_is_around_what_kept_control():
    low, high = scene().box
    path = scene().movers[1].path
    assert (low < path.min(axis=0)).all()
    assert (high > path.max(axis=0)).all()
    assert high[0] < 1.5  # the lost one was at 2 m
    kept = inside(scene(), scene().movers[0].path)
    assert np.isnan(kept[0]).all()
    only = scene(movers=scene().movers[:1], target=None)
    assert only.box[1][0] > 2  # without other flights, the box is around the lost one


@pytest.mark.parametrize("equal", [True, False])
def test_a_vehicle_is_drawn_undistorted(equal):
    """On the screen, where the box has the proportions of its sides, arms at right angles stay at right angles and have the same
    length."""
    one = scene(equal=equal)
    low, high = one.box
    from barbalat.vehicles.picture import sides

    drawn = [np.diff(line, axis=0)[0] / (high - low) * sides(one) for line in frame(one, one.movers[1].path[5], np.eye(3))]
    assert drawn[0] @ drawn[1] == pytest.approx(0)
    assert np.linalg.norm(drawn[0]) == pytest.approx(np.linalg.norm(drawn[1]))


def test_angles_turn_yaw_first():
    R = attitudes(np.array([10.0]), np.array([20.0]), np.array([30.0]))[0]
    turns = (("z", 30), ("y", 20), ("x", 10))
    yaw, pitch, roll = (Rotation.from_euler(axis, angle, degrees=True).as_matrix() for axis, angle in turns)
    np.testing.assert_allclose(R, yaw @ pitch @ roll, atol=1e-12)


def test_a_path_s_picture_is_drawn_for_a_page_and_for_a_phone():
    wide, narrow = (paths_figure(scene(), narrow=narrow) for narrow in (False, True))
    assert narrow.get_size_inches()[0] < 4.2 < wide.get_size_inches()[0]
    texts = [text.get_text() for text in wide.legends[0].get_texts()]
    assert texts == ["commanded path", "first, lost", "second"]
    for figure in (wide, narrow):
        picture = np.asarray(Image.open(io.BytesIO(render(figure, "png"))).convert("L"))
        drawn = np.flatnonzero((picture < 250).any(axis=1))
        dots = len(picture) / figure.get_size_inches()[1]  # of an inch
        assert np.diff(drawn).max() < 0.35 * dots  # no empty band below the legend, nor anywhere else
        assert len(picture) - drawn[-1] < 0.25 * dots
