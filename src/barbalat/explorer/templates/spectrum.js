// Checks whether a solver's step is stable at an instant of a run, by the eigenvalues of the exact Jacobian at that instant.

// Eigenvalues of a real matrix (size * size, row by row) as {re, im}; null if the iteration does not converge.
export function eigenvalues(matrix, size) {
  const re = balanced(matrix, size);
  const im = new Float64Array(size * size);
  reduced(re, size);
  const at = (i, j) => i * size + j;
  const found = { re: new Float64Array(size), im: new Float64Array(size) };
  const big = (i, j) => Math.abs(re[at(i, j)]) + Math.abs(im[at(i, j)]);
  let rounds = 0;
  for (let last = size - 1; last >= 0;) {
    let first = last;
    while (first > 0 && big(first, first - 1) > Number.EPSILON * (big(first, first) + big(first - 1, first - 1))) first--;
    if (first === last) {
      found.re[last] = re[at(last, last)];
      found.im[last] = im[at(last, last)];
      last--;
      rounds = 0;
    } else if (++rounds > 60) return null;
    else turned(re, im, size, first, last, shiftOf(re, im, at, last, rounds));
  }
  return found;
}

// Balances the matrix: scales rows and columns by powers of two until their norms are about equal.
function balanced(matrix, size) {
  const a = Float64Array.from(matrix);
  for (let again = true; again;) {
    again = false;
    for (let i = 0; i < size; i++) {
      let [c, r] = [0, 0];
      for (let j = 0; j < size; j++) if (j !== i) [c, r] = [c + Math.abs(a[j * size + i]), r + Math.abs(a[i * size + j])];
      if (c === 0 || r === 0) continue;
      const f = 2 ** Math.round(Math.log2(r / c) / 2);
      if (c * f + r / f >= 0.95 * (c + r)) continue;
      again = true;
      for (let j = 0; j < size; j++) [a[i * size + j], a[j * size + i]] = j === i ? [a[i * size + i], a[i * size + i]] : [a[i * size + j] / f, a[j * size + i] * f];
    }
  }
  return a;
}

// Reduces the matrix to Hessenberg form in place, by elimination with pivoting.
function reduced(a, size) {
  for (let m = 1; m < size - 1; m++) {
    let pivot = m;
    for (let i = m + 1; i < size; i++) if (Math.abs(a[i * size + m - 1]) > Math.abs(a[pivot * size + m - 1])) pivot = i;
    const x = a[pivot * size + m - 1];
    if (x === 0) continue;
    for (let j = 0; j < size; j++) [a[pivot * size + j], a[m * size + j]] = [a[m * size + j], a[pivot * size + j]];
    for (let i = 0; i < size; i++) [a[i * size + pivot], a[i * size + m]] = [a[i * size + m], a[i * size + pivot]];
    for (let i = m + 1; i < size; i++) {
      const y = a[i * size + m - 1] / x;
      if (y === 0) continue;
      for (let j = m - 1; j < size; j++) a[i * size + j] -= y * a[m * size + j];
      for (let j = 0; j < size; j++) a[j * size + m] += y * a[j * size + i];
    }
  }
}

function product([a, b], [c, d]) {
  return [a * c - b * d, a * d + b * c];
}

function root([a, b]) {
  const size = Math.hypot(a, b);
  const re = Math.sqrt((size + a) / 2);
  return [re, Math.sign(b || 1) * Math.sqrt(Math.max((size - a) / 2, 0))];
}

// The shift: the eigenvalue of the trailing 2 by 2 block nearer to its last entry. Every tenth round takes an exceptional shift.
function shiftOf(re, im, at, last, rounds) {
  const entry = (i, j) => [re[at(i, j)], im[at(i, j)]];
  if (rounds % 10 === 0) return [re[at(last, last)] + Math.abs(re[at(last, last - 1)]), im[at(last, last)]];
  const [a, b, c, d] = [entry(last - 1, last - 1), entry(last - 1, last), entry(last, last - 1), entry(last, last)];
  const half = [(a[0] - d[0]) / 2, (a[1] - d[1]) / 2];
  const bc = product(b, c);
  const square = product(half, half);
  const s = root([square[0] + bc[0], square[1] + bc[1]]);
  const sign = half[0] * s[0] + half[1] * s[1] > 0 ? -1 : 1;
  return [d[0] + half[0] + sign * s[0], d[1] + half[1] + sign * s[1]];
}

// Makes one step of the QR iteration on the rows and columns first ... last.
function turned(re, im, size, first, last, [sRe, sIm]) {
  const turns = [];
  for (let k = first; k <= last; k++) [re[k * size + k], im[k * size + k]] = [re[k * size + k] - sRe, im[k * size + k] - sIm];
  for (let k = first; k < last; k++) {
    const [p, q] = [k * size + k, (k + 1) * size + k];
    const length = Math.hypot(re[p], im[p], re[q], im[q]) || 1;
    const turn = [re[p] / length, im[p] / length, re[q] / length, im[q] / length];
    turns.push(turn);
    const [a, b, c, d] = turn;
    for (let j = k; j <= last; j++) {
      const [x, y] = [k * size + j, (k + 1) * size + j];
      const [xr, xi, yr, yi] = [re[x], im[x], re[y], im[y]];
      re[x] = a * xr + b * xi + c * yr + d * yi;
      im[x] = a * xi - b * xr + c * yi - d * yr;
      re[y] = a * yr - b * yi - c * xr + d * xi;
      im[y] = a * yi + b * yr - c * xi - d * xr;
    }
  }
  turns.forEach(([a, b, c, d], index) => {
    const k = first + index;
    for (let i = first; i <= Math.min(k + 1, last); i++) {
      const [x, y] = [i * size + k, i * size + k + 1];
      const [xr, xi, yr, yi] = [re[x], im[x], re[y], im[y]];
      re[x] = xr * a - xi * b + yr * c - yi * d;
      im[x] = xr * b + xi * a + yr * d + yi * c;
      re[y] = yr * a + yi * b - xr * c - xi * d;
      im[y] = yi * a - yr * b - xi * c + xr * d;
    }
  });
  for (let k = first; k <= last; k++) [re[k * size + k], im[k * size + k]] = [re[k * size + k] + sRe, im[k * size + k] + sIm];
}

// ln |R(z)| of the method's polynomial, minus the growth of the exact solution.
function spurious(polynomial, z) {
  let value = [0, 0];
  for (let k = polynomial.length - 1; k >= 0; k--) {
    value = product(value, z);
    value[0] += polynomial[k];
  }
  return Math.log(Math.hypot(...value)) - Math.max(z[0], 0);
}

// The largest h |lambda| of a matrix's eigenvalues, and whether the method amplifies a mode that the equations do not amplify.
export function look(matrix, size, task) {
  if (!matrix.every(Number.isFinite)) return { largest: 0, outside: true }; // an overflow counts as far outside
  const found = eigenvalues(matrix, size);
  if (found === null) return { largest: 0, outside: false }; // no statement is made without eigenvalues
  let [largest, outside] = [0, false];
  for (let i = 0; i < size; i++) {
    const z = [found.re[i] * task.dt, found.im[i] * task.dt];
    largest = Math.max(largest, Math.hypot(...z));
    outside ||= spurious(task.polynomial, z) * task.grid.steps > 1;
  }
  return { largest, outside };
}
