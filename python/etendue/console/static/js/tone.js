// From numbers to display colors: the tone mapping of the renderer (crates/render/src/image/tonemap.rs; a test compares both), and
// ways to show layers that are no pictures. Everything returns bytes for an ImageData.

/** Single precision numbers of all 65,536 half precision bit patterns. */
const HALVES = (() => {
  const table = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const sign = bits & 0x8000 ? -1 : 1;
    const exponent = (bits >> 10) & 31;
    const fraction = bits & 1023;
    table[bits] =
      exponent === 0
        ? sign * fraction * 2 ** -24
        : exponent === 31
          ? fraction
            ? NaN
            : sign * Infinity
          : sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
  }
  return table;
})();

/** Numbers of half precision bits. */
export function fromHalves(bits) {
  const out = new Float32Array(bits.length);
  for (let i = 0; i < bits.length; i++) out[i] = HALVES[bits[i]];
  return out;
}

const clamp = (v, lo = 0, hi = 1) => (v < lo ? lo : v > hi ? hi : v);
const srgb = (v) => (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
// Close enough for bytes: the curve is sampled where bytes differ.
const SRGB_STEPS = 16384;
const SRGB = Uint8ClampedArray.from({ length: SRGB_STEPS + 1 }, (_, i) => Math.round(255 * srgb(i / SRGB_STEPS)));
const encoded = (v) => SRGB[(clamp(v) * SRGB_STEPS + 0.5) | 0];

const hable = (x) => (x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.5) + 0.06) - 0.02 / 0.3;
const HABLE_WHITE = hable(11.2);

const mul = (m, r, g, b) => [m[0] * r + m[1] * g + m[2] * b, m[3] * r + m[4] * g + m[5] * b, m[6] * r + m[7] * g + m[8] * b];
const ACES_IN = [0.59719, 0.35458, 0.04823, 0.076, 0.90834, 0.01566, 0.0284, 0.13383, 0.83777];
const ACES_OUT = [1.60475, -0.53108, -0.07367, -0.10208, 1.10813, -0.00605, -0.00327, -0.07276, 1.07602];
const AGX_IN = [0.84247906, 0.0784336, 0.079223745, 0.042328242, 0.87846864, 0.07916613, 0.042375655, 0.0784336, 0.87914297];
const AGX_OUT = [1.196879, -0.09802088, -0.099029744, -0.05289685, 1.1519031, -0.09896118, -0.052971635, -0.09804345, 1.1510737];
const acesFit = (v) => (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.432951) + 0.238081);
const agxFit = (v) => {
  const t = clamp((Math.log2(Math.max(v, 1e-10)) + 12.47393) / 16.499999);
  return (((((15.5 * t - 40.14) * t + 31.96) * t - 6.868) * t + 0.4298) * t + 0.1191) * t - 0.00232;
};

/** Tone operators by name: (r, g, b) linear and positive to three bytes. */
const OPERATORS = {
  standard: (r, g, b) => [encoded(r), encoded(g), encoded(b)],
  filmic: (r, g, b) => [r, g, b].map((v) => encoded(hable(2 * v) / HABLE_WHITE)),
  aces: (r, g, b) => mul(ACES_OUT, ...mul(ACES_IN, r, g, b).map(acesFit)).map(encoded),
  agx: (r, g, b) => mul(AGX_OUT, ...mul(AGX_IN, r, g, b).map(agxFit)).map((v) => Math.round(255 * clamp(v))),
};
export const OPERATOR_NAMES = Object.keys(OPERATORS);

/** A color scale that is dark to bright for everyone (Google's Turbo is not; this follows viridis). */
const SCALE = [
  [68, 1, 84],
  [71, 44, 122],
  [59, 81, 139],
  [44, 113, 142],
  [33, 144, 141],
  [39, 173, 129],
  [92, 200, 99],
  [170, 220, 50],
  [253, 231, 37],
];
export function scaleColor(t) {
  const x = clamp(t) * (SCALE.length - 1);
  const i = Math.min(SCALE.length - 2, Math.floor(x));
  return SCALE[i].map((v, k) => Math.round(v + (SCALE[i + 1][k] - v) * (x - i)));
}

/** A color for a number of an object: different neighbors, the same each time. */
function idColor(id) {
  if (id <= 0) return [20, 20, 24];
  let h = Math.imul(id | 0, 0x9e3779b1) >>> 0;
  h ^= h >>> 15;
  h = Math.imul(h, 0x85ebca6b) >>> 0;
  return [80 + (h & 127), 80 + ((h >>> 8) & 127), 80 + ((h >>> 16) & 127)];
}

/** Smallest and largest number without the outermost hundredths, of numbers that are finite and above 0 unless `all`. */
function range(data, all = false) {
  const step = Math.max(1, Math.floor(data.length / 20000));
  const values = [];
  for (let i = 0; i < data.length; i += step) if (Number.isFinite(data[i]) && (all || data[i] > 0)) values.push(data[i]);
  if (!values.length) return [0, 1];
  values.sort((a, b) => a - b);
  const at = (q) => values[Math.min(values.length - 1, Math.floor(q * values.length))];
  const [low, high] = [at(0.01), at(0.99)];
  return high > low ? [low, high] : [low - 0.5, low + 0.5];
}

/** What a layer's kind of showing is. */
function kindOf(frame) {
  const name = frame.layer;
  if (name === "normal") return "normal";
  if (name === "object" || name === "material") return "id";
  if (name === "uv") return "uv";
  if (name === "position") return "position";
  if (name === "variance") return "logscale";
  if (frame.channels === 1) return name === "alpha" || name === "Y" ? "gray" : "scale";
  return "color";
}

/**
 * Bytes (r, g, b, 255) of a frame.
 * @param frame {width, height, channels, layer, data: Float32Array}
 * @param options {exposure in stops, operator}
 */
export function develop(frame, { exposure = 0, operator = "standard" } = {}) {
  const { data, channels } = frame;
  const count = frame.width * frame.height;
  const out = new Uint8ClampedArray(4 * count);
  const put = (i, [r, g, b]) => {
    out[4 * i] = r;
    out[4 * i + 1] = g;
    out[4 * i + 2] = b;
  };
  const gain = 2 ** exposure;
  const kind = kindOf(frame);
  if (kind === "color") {
    const map = OPERATORS[operator] ?? OPERATORS.standard;
    const safe = (v) => (v > 0 ? Math.min(v * gain, 1e6) : 0);
    if (operator === "standard") {
      // The common case without garbage.
      for (let i = 0; i < count; i++) {
        const at = i * channels;
        for (let c = 0; c < 3; c++) out[4 * i + c] = encoded(safe(data[at + c]));
      }
    } else {
      for (let i = 0; i < count; i++) {
        const at = i * channels;
        put(i, map(safe(data[at]), safe(data[at + 1]), safe(data[at + 2])));
      }
    }
  } else if (kind === "gray") {
    for (let i = 0; i < count; i++) put(i, Array(3).fill(Math.round(255 * clamp(data[i]))));
  } else if (kind === "normal") {
    for (let i = 0; i < 3 * count; i++) out[4 * Math.floor(i / 3) + (i % 3)] = 127.5 + 127.5 * clamp(data[i], -1, 1);
  } else if (kind === "id") {
    for (let i = 0; i < count; i++) put(i, idColor(data[i]));
  } else if (kind === "uv") {
    for (let i = 0; i < count; i++) {
      const [u, v] = [data[2 * i], data[2 * i + 1]];
      put(i, [255 * (u - Math.floor(u)), 255 * (v - Math.floor(v)), 64]);
    }
  } else if (kind === "position") {
    for (let c = 0; c < 3; c++) {
      const plane = data.filter((_, i) => i % 3 === c);
      const [low, high] = range(plane, true);
      for (let i = 0; i < count; i++) out[4 * i + c] = (255 * (plane[i] - low)) / (high - low);
    }
  } else {
    const isLog = kind === "logscale";
    const value = (i) => {
      if (channels === 1) return data[i];
      return (data[i * channels] + data[i * channels + 1] + data[i * channels + 2]) / 3;
    };
    const numbers = Float32Array.from({ length: count }, (_, i) => (isLog ? Math.log10(Math.max(value(i), 1e-9)) : value(i)));
    const [low, high] = range(numbers, isLog);
    const nothing = [14, 14, 18];
    for (let i = 0; i < count; i++) {
      const t = (numbers[i] * (isLog ? 1 : gain) - low) / (high - low);
      put(i, numbers[i] === 0 && !isLog ? nothing : scaleColor(frame.layer === "depth" ? 1 - t : t));
    }
  }
  // What is no number stands out: it is a fault of scene or program.
  for (let i = 0; i < count; i++) {
    out[4 * i + 3] = 255;
    for (let c = 0; c < channels; c++) {
      if (Number.isNaN(data[i * channels + c])) put(i, [255, 0, 255]);
    }
  }
  return out;
}

/** Bytes that show where and how much two frames of one size differ; gray and equal is black. */
export function developDifference(a, b, { exposure = 0 } = {}) {
  const count = a.width * a.height;
  const out = new Uint8ClampedArray(4 * count);
  const gain = 2 ** exposure;
  for (let i = 0; i < count; i++) {
    let sum = 0;
    for (let c = 0; c < a.channels; c++) {
      const [x, y] = [a.data[i * a.channels + c], b.data[i * b.channels + c]];
      // Relative where it is bright, absolute where it is dark.
      sum += Math.abs(x - y) / (0.1 + 0.5 * (Math.abs(x) + Math.abs(y)));
    }
    const [r, g, bl] = sum === 0 ? [0, 0, 0] : scaleColor((gain * sum) / a.channels);
    out.set([r, g, bl, 255], 4 * i);
  }
  return out;
}
