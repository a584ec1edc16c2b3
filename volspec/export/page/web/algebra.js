// Vectors and matrices as plain arrays in double precision; a matrix is an array of rows.

const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);

const applied = (matrix, v) => matrix.map((row) => dot(row, v));

const transposed = (m) => m[0].map((_, j) => m.map((row) => row[j]));

function product(a, b) {
  const columns = transposed(b);
  return a.map((row) => columns.map((column) => dot(row, column)));
}

const diagonal = (v) => v.map((x, i) => v.map((_, j) => (i === j ? x : 0)));

const identity = () => diagonal([1, 1, 1]);

// Row i times v[i]: diag(v) · m.
const scaledRows = (m, v) => m.map((row, i) => row.map((x) => x * v[i]));

const scaled = (m, factor) => m.map((row) => row.map((x) => x * factor));

// The inverse of a 3 x 3 matrix, by cofactors.
function inverted(m) {
  const [[a, b, c], [d, e, f], [g, h, i]] = m;
  const A = e * i - f * h, B = f * g - d * i, C = d * h - e * g;
  const determinant = a * A + b * B + c * C;
  return [
    [A, c * h - b * i, b * f - c * e],
    [B, a * i - c * g, c * d - a * f],
    [C, b * g - a * h, a * e - b * d],
  ].map((row) => row.map((x) => x / determinant));
}

const clamped = (x, low, high) => Math.min(Math.max(x, low), high);

// |x|^p with the sign of x.
const signedPower = (x, p) => Math.sign(x) * Math.abs(x) ** p;

// Linear between points in ascending order; constant beyond the ends.
function interpolated(x, at, values) {
  if (x <= at[0]) return values[0];
  for (let i = 1; i < at.length; i++) {
    if (x > at[i]) continue;
    const fraction = (x - at[i - 1]) / (at[i] - at[i - 1]);
    return values[i - 1] + fraction * (values[i] - values[i - 1]);
  }
  return values[values.length - 1];
}
