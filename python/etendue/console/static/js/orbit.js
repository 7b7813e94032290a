// Moving a camera around a point. Matrices are 4 × 4 as rows (16 numbers): columns right, up, back, place.

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const unit = (a) => {
  const l = Math.hypot(...a) || 1;
  return a.map((v) => v / l);
};

/** Rotates a vector around a unit axis (Rodrigues). */
function turned(v, axis, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const k = dot(axis, v) * (1 - c);
  const x = cross(axis, v);
  return [0, 1, 2].map((i) => v[i] * c + x[i] * s + axis[i] * k);
}

const LOWEST = 0.02;

/** A camera that orbits. */
export class Orbit {
  /** @param matrix 16 numbers; pivot: a point, or null for one unit ahead. */
  constructor(matrix, pivot = null) {
    const column = (c) => [matrix[c], matrix[4 + c], matrix[8 + c]];
    this.right = unit(column(0));
    this.up = unit(column(1));
    this.back = unit(column(2));
    this.place = column(3);
    this.scale = Math.hypot(...column(0)) || 1;
    this.zoom = 1;
    this.pivot = pivot ?? add(this.place, this.back, -1);
    // POV-Ray's space is left-handed: turns go the other way.
    this.hand = Math.sign(dot(cross(this.right, this.up), this.back)) || 1;
    // The world's up is the axis that the camera's up is nearest to.
    const axis = this.up.map(Math.abs).indexOf(Math.max(...this.up.map(Math.abs)));
    this.worldUp = [0, 0, 0];
    this.worldUp[axis] = Math.sign(this.up[axis]) || 1;
  }

  get distance() {
    return Math.max(1e-6, Math.hypot(...add(this.place, this.pivot, -1)));
  }

  get matrix() {
    const rows = [];
    for (let i = 0; i < 3; i++) rows.push(this.right[i] * this.scale, this.up[i] * this.scale, this.back[i] * this.scale, this.place[i]);
    return [...rows, 0, 0, 0, 1];
  }

  #turn(axis, angle) {
    const arm = turned(add(this.place, this.pivot, -1), axis, angle);
    this.place = add(this.pivot, arm);
    for (const name of ["right", "up", "back"]) this[name] = unit(turned(this[name], axis, angle));
  }

  /** Around the pivot: angles in radians, to the right and up. */
  orbit(dx, dy) {
    this.#turn(this.worldUp, -dx * this.hand);
    // Never over the poles: the horizon would turn upside down.
    const height = dot(this.back, this.worldUp);
    const latitude = Math.asin(Math.max(-1, Math.min(1, height)));
    const limit = Math.PI / 2 - LOWEST;
    const wanted = Math.max(Math.min(latitude, -limit), Math.min(Math.max(latitude, limit), latitude + dy));
    this.#turn(this.right, -(wanted - latitude) * this.hand);
  }

  /** Sideways, in shares of the distance to the pivot. */
  pan(dx, dy) {
    const d = this.distance;
    const move = add(this.right.map((v) => v * dx * d), this.up, dy * d);
    this.place = add(this.place, move);
    this.pivot = add(this.pivot, move);
  }

  /** Towards the pivot: the distance is multiplied by `factor`. */
  dolly(factor) {
    this.place = add(this.pivot, add(this.place, this.pivot, -1).map((v) => v * factor));
  }

  /** Looks around from where it stands. */
  look(dx, dy) {
    const { place } = this;
    const distance = this.distance;
    this.pivot = place;
    this.orbit(dx, dy);
    this.place = place;
    this.pivot = add(place, this.back, -distance);
  }
}
