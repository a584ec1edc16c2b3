// Weights of the lights: effective ones with solo, and the dial that blends lights.
//
// Twin of volspec/viewer/model/{lights,light_rows}.py [Bergner et al. 2005: the light dial].

// Effective weights; `solo` is the light that is on alone, or -1.
const shining = ({ weights, solo }) => (
  weights.map((weight, i) => (solo < 0 || solo === i ? weight : 0)));

// Positions of lights on the dial's rim, clockwise from the top; y runs down.
const dialCorners = (count) => Array.from({ length: count }, (_, i) => {
  const angle = 2 * Math.PI * i / count;
  return [Math.sin(angle), -Math.cos(angle)];
});

// Weights, of sum 1, at a point of a dial of radius 1: linear in each triangle of the fan around
// the centre, where all weights are equal; points outside are moved to the edge.
function dialWeights(count, x, y) {
  if (count < 2) return new Array(count).fill(1);
  if (count === 2) {
    const upper = clamped((1 - y) / 2, 0, 1);
    return [upper, 1 - upper];
  }
  const rim = dialCorners(count), turn = 2 * Math.PI;
  const angle = ((Math.atan2(x, -y) % turn) + turn) % turn;
  const sector = Math.floor(angle / (turn / count)) % count, after = (sector + 1) % count;
  const [[ax, ay], [bx, by]] = [rim[sector], rim[after]], area = ax * by - bx * ay;
  let first = Math.max((x * by - bx * y) / area, 0), second = Math.max((ax * y - x * ay) / area, 0);
  const total = first + second;
  if (total > 1) { first /= total; second /= total; }
  const weights = new Array(count).fill((1 - Math.min(total, 1)) / count);
  weights[sector] += first;
  weights[after] += second;
  return weights;
}

// Point of the dial for weights: the centroid of the lights.
function dialPlace(weights) {
  const total = weights.reduce((a, b) => a + b, 0);
  if (total <= 0) return [0, 0];
  return [0, 1].map((axis) => (
    dialCorners(weights.length).reduce((sum, p, i) => sum + weights[i] * p[axis], 0) / total));
}

// Weights at a point of the dial, scaled so that the strongest is 1.
function blendedWeights(count, x, y) {
  const weights = dialWeights(count, x, y), most = Math.max(...weights);
  return weights.map((weight) => weight / most);
}
