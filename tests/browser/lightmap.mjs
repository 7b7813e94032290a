// Bakes scenes/baking/room.xml, loads the result in Chromium with stock three.js, and compares the screenshot with our own picture of the
// same file, and with a path-traced picture of the scene as it was; then bakes the same room as glTF by each method and compares those.
//
//   npm install && npm test            needs Chromium (CHROMIUM, default /usr/bin/chromium) and a built `etendue` (ETENDUE)
//
// What is missing is said and the test skipped, with exit code 0.

import { execFileSync } from 'node:child_process';
import { existsSync, mkdirSync, readFileSync, mkdtempSync, rmSync } from 'node:fs';
import { createServer } from 'node:http';
import { tmpdir } from 'node:os';
import { dirname, extname, join, normalize } from 'node:path';
import { fileURLToPath } from 'node:url';

const here = dirname(fileURLToPath(import.meta.url));
const root = join(here, '..', '..');
const chromium = process.env.CHROMIUM ?? '/usr/bin/chromium';
const etendue = process.env.ETENDUE ?? ['release', 'debug'].map((p) => join(root, 'target', p, 'etendue')).find(existsSync);
const [width, height] = [480, 320];

function skip(what) {
  console.log(`SKIPPED: the browser test of baked scenes needs ${what}`);
  process.exit(0);
}
if (!existsSync(chromium)) skip(`Chromium at ${chromium} (apt-get install chromium, or set CHROMIUM)`);
if (!['three', 'pngjs', 'playwright-core'].every((name) => existsSync(join(here, 'node_modules', name)))) skip('its packages (npm install in tests/browser)');
if (!etendue || !existsSync(etendue)) skip('a built `etendue` (cargo build, or set ETENDUE)');

const { chromium: browserType } = await import('playwright-core');
const { PNG } = await import('pngjs');

const out = process.env.OUT ?? mkdtempSync(join(tmpdir(), 'etendue-browser-'));
mkdirSync(out, { recursive: true });
const scene = join(root, 'scenes', 'baking', 'room.xml');
const run = (...args) => execFileSync(etendue, args, { stdio: ['ignore', 'inherit', 'inherit'] });

// A file is served from the folder of the test, or, under /out/, from the folder of the results.
const types = { '.html': 'text/html', '.js': 'text/javascript', '.glb': 'model/gltf-binary' };
const server = createServer((request, response) => {
  const path = normalize(decodeURIComponent(new URL(request.url, 'http://localhost').pathname));
  const file = path.startsWith('/out/') ? join(out, path.slice(5)) : join(here, path);
  if (path === '/favicon.ico') return response.writeHead(204).end();
  if (path.includes('..') || !existsSync(file)) return response.writeHead(404).end();
  response.writeHead(200, { 'content-type': types[extname(file)] ?? 'application/octet-stream' }).end(readFileSync(file));
});
await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));

const flags = ['--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking', '--disable-component-update',
  '--disable-sync', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist'];
const browser = await browserType.launch({ executablePath: chromium, args: flags });

async function screenshot(name, query = '') {
  const page = await browser.newPage({ viewport: { width, height } });
  page.on('console', (m) => m.type() === 'error' && console.log(`  page: ${m.text()}`));
  const file = encodeURIComponent(`/out/${name}.glb`);
  await page.goto(`http://127.0.0.1:${server.address().port}/viewer.html?width=${width}&height=${height}&file=${file}${query}`);
  await page.waitForFunction('window.result', null, { timeout: 120000 });
  const result = await page.evaluate('window.result');
  if (result.error) throw new Error(`${name}: ${result.error}`);
  await page.screenshot({ path: join(out, `${name}.browser.png`) });
  await page.close();
  return result;
}

// Means over squares of pixels, in linear light: noise goes, what is wrong stays.
function blocks(picture, edge) {
  const linear = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  const means = [];
  for (let y = 0; y + edge <= picture.height; y += edge) {
    for (let x = 0; x + edge <= picture.width; x += edge) {
      for (let k = 0; k < 3; k++) {
        let sum = 0;
        for (let i = 0; i < edge * edge; i++) {
          sum += linear(picture.data[4 * ((y + Math.floor(i / edge)) * picture.width + x + (i % edge)) + k] / 255);
        }
        means.push(sum / edge / edge);
      }
    }
  }
  return means;
}

// Mean relative difference of the block means, and that of the whole pictures.
function compareBlocks(a, b, edge = 16) {
  const [x, y] = [blocks(a, edge), blocks(b, edge)];
  const sum = (v) => v.reduce((s, w) => s + w, 0);
  const difference = sum(x.map((v, i) => Math.abs(v - y[i]) / Math.max(y[i], 0.02))) / x.length;
  return { difference, bias: sum(x) / sum(y) - 1 };
}

const load = (file) => PNG.sync.read(readFileSync(join(out, file)));

// Mean difference of two pictures in steps of 8 bits, mean of the signed difference, and share of pixels that differ by more than 16.
function compare(a, b) {
  let [sum, signed, far] = [0, 0, 0];
  const pixels = a.width * a.height;
  if (b.width !== a.width || b.height !== a.height) throw new Error('pictures of different sizes');
  for (let i = 0; i < pixels; i++) {
    let most = 0;
    for (let k = 0; k < 3; k++) {
      const d = a.data[4 * i + k] - b.data[4 * i + k];
      sum += Math.abs(d);
      signed += d;
      most = Math.max(most, Math.abs(d));
    }
    far += most > 16;
  }
  return { mean: sum / pixels / 3, bias: signed / pixels / 3, far: far / pixels };
}

let [passed, failed] = [0, 0];
function check(what, holds, figures) {
  console.log(`${holds ? 'ok' : 'FAILED'}: ${what} (${figures})`);
  if (holds) passed += 1; else failed += 1;
}
const figures = (d) => `mean difference ${d.mean.toFixed(2)}, bias ${d.bias.toFixed(2)} of 255, ${(100 * d.far).toFixed(2)} % of pixels beyond 16`;

const spp = process.env.SPP ?? '32';
run('render', scene, '--spp', spp, '-o', join(out, 'direct.png'), '--quiet');
const kinds = [['emissive', []], ['unlit', ['--display', 'unlit']], ['lightmap', ['--display', 'lightmap']], ['vertices', ['--per-vertex']]];
for (const [name, flags] of kinds) {
  run('bake', scene, '-o', join(out, `${name}.glb`), '--resolution', '512', '--spp', spp, '--quiet', ...flags);
  run('render', join(out, `${name}.glb`), '--width', String(width), '--height', String(height), '--max-depth', '0', '--spp', '16',
    '--filter', 'box', '-o', join(out, `${name}.png`), '--quiet');
  const { meshes, withLight } = await screenshot(name, name === 'lightmap' ? '&plugin=1' : '');
  check(`${name}: meshes that show light`, withLight >= 18 && meshes - withLight === 2, `${withLight} of ${meshes}`);
  const browserPicture = load(`${name}.browser.png`);
  // What a lightmap lights is shown by engines alone, not by a renderer, which would compute the light itself.
  if (name !== 'lightmap') {
    const own = compare(browserPicture, load(`${name}.png`));
    check(`${name}: Chromium shows what we show of the same file`, own.mean < 2.5 && Math.abs(own.bias) < 1 && own.far < 0.03, figures(own));
  }
  if (name !== 'vertices') {
    const d = compareBlocks(browserPicture, load('direct.png'));
    check(`${name}: Chromium shows the scene as path traced`, d.difference < 0.06 && Math.abs(d.bias) < 0.03,
      `blocks differ by ${(100 * d.difference).toFixed(2)} %, the whole by ${(100 * d.bias).toFixed(2)} %`);
  }
}

// The same glTF baked by each method looks the same in Chromium; noise is most of what differs.
const glb = join(out, 'room.glb');
run('convert', scene, glb, '--quiet');
const pictures = {};
for (const method of ['path', 'radiosity', 'particles']) {
  run('bake', glb, '-o', join(out, `${method}.glb`), '--method', method, '--resolution', '256', '--spp', String(4 * spp), '--quiet');
  await screenshot(method);
  pictures[method] = load(`${method}.browser.png`);
}
for (const [a, b] of [['radiosity', 'path'], ['particles', 'path'], ['radiosity', 'particles']]) {
  const d = compareBlocks(pictures[a], pictures[b], 80);
  check(`Chromium shows ${a} as ${b}`, d.difference < 0.025 && Math.abs(d.bias) < 0.01,
    `blocks differ by ${(100 * d.difference).toFixed(2)} %, the whole by ${(100 * d.bias).toFixed(2)} %`);
}
await browser.close();
server.close();
if (!process.env.OUT) rmSync(out, { recursive: true });
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed ? 1 : 0);
