// Changes a panel's interval by keyboard and by touch. uPlot itself handles dragging with the mouse.

const CLOSER = 0.7; // fraction of the interval that is left after a press of +
const MOVED = 0.2; // fraction of the interval by which an arrow moves it

// charts offers shown(), which returns the interval [min, max], and zoom(min, max), which sets it. ends() returns the ends of the
// run, and whole() shows the whole run.
export function gestures(box, charts) {
  box.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const [min, max] = charts.shown();
    const width = max - min;
    const by = {
      "+": () => charts.zoom(min + (width * (1 - CLOSER)) / 2, max - (width * (1 - CLOSER)) / 2),
      "-": () => charts.zoom(min - (width * (1 / CLOSER - 1)) / 2, max + (width * (1 / CLOSER - 1)) / 2),
      ArrowLeft: () => moved(charts, -MOVED * width), ArrowRight: () => moved(charts, MOVED * width), 0: () => charts.whole(), Escape: () => charts.whole(),
    }[event.key === "=" ? "+" : event.key];
    if (!by) return;
    event.preventDefault();
    by();
  });
  touches(box, charts);
}

// Moves the interval by this much, but not beyond the ends of the run.
function moved(charts, by) {
  const [min, max] = charts.shown();
  const [first, last] = charts.ends();
  const free = Math.min(Math.max(by, first - min), last - max);
  if (free) charts.zoom(min + free, max + free);
}

// Two fingers zoom, and each stays over its instant; one finger moves the zoomed interval. Vertical movement scrolls the page.
function touches(box, charts) {
  let held = null;
  const places = (event) => {
    const over = box.querySelector(".u-over").getBoundingClientRect();
    return Array.from(event.touches, (one) => (one.clientX - over.left) / over.width);
  };
  const hold = (event) => {
    const [min, max] = charts.shown();
    held = event.touches.length ? { at: places(event).map((share) => min + share * (max - min)) } : null;
  };
  box.addEventListener("touchstart", hold, { passive: true });
  box.addEventListener("touchend", hold, { passive: true });
  box.addEventListener("touchmove", (event) => {
    if (!held || held.at.length !== event.touches.length) return;
    const shares = places(event);
    const [min, max] = charts.shown();
    if (shares.length === 1) {
      moved(charts, held.at[0] - (min + shares[0] * (max - min)));
    } else if (shares.length === 2 && Math.abs(shares[1] - shares[0]) > 0.02) {
      const width = (held.at[1] - held.at[0]) / (shares[1] - shares[0]);
      if (width > 0) charts.zoom(held.at[0] - shares[0] * width, held.at[0] + (1 - shares[0]) * width);
      event.preventDefault();
    }
  }, { passive: false });
}
