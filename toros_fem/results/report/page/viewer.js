"use strict";
(() => {
  const FABRIC = [0.93, 0.86, 0.72], PRINTED = [0.13, 0.2, 0.33], TARGET = [0.42, 0.66, 0.42];
  // Colours of equal steps of lightness (viridis, by Smith and van der Walt, CC0).
  const SCALE = ["#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779",
    "#6ece58", "#b5de2b", "#fde725"];
  // Faces that meet at a larger angle have an edge between them.
  const SMOOTH = Math.cos((40 * Math.PI) / 180);
  const WORDS = { pressure: "pressure", iteration: "design iteration", gait: "gait",
    load: "on the object" };
  const at = (id) => document.getElementById(id);
  const scene = JSON.parse(at("scene").textContent);

  function say(text) {
    at("message").textContent = text;
    at("message").hidden = false;
    document.documentElement.dataset.state = "failed";
  }

  for (const name of ["curve", "convergence", "pattern", "figures", "files", "inputs", "warnings", "tolerance"]) {
    const section = at(name);
    if (!section.querySelector("svg, table, dl, li")) section.hidden = true;
  }

  async function unpack(text) {
    const raw = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const stream = new Blob([raw]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  function reader(bytes) {
    const kinds = { uint8: Uint8Array, uint16: Uint16Array, uint32: Uint32Array };
    return (entry) => {
      const values = new kinds[entry.type](entry.count), width = values.BYTES_PER_ELEMENT;
      for (let byte = 0; byte < width; byte++) {
        const begin = entry.at + byte * entry.count, shift = 8 * byte;
        for (let k = 0; k < entry.count; k++) values[k] |= bytes[begin + k] << shift;
      }
      return values;
    };
  }

  /* Arrays are stored as changes from one frame of a skin to its next. */
  function unpackSeries(read, entries) {
    const before = new Map();
    for (const entry of entries) {
      for (const name of ["positions", "stretch", "density"]) {
        if (!entry[name]) continue;
        const values = read(entry[name]), key = entry.skin + name, last = before.get(key);
        if (last) for (let k = 0; k < values.length; k++) values[k] += last[k];
        before.set(key, values);
        entry[name] = values;
      }
    }
  }

  const placed = (grid) => {
    const out = new Float32Array(grid.length);
    // In mm, from the box's corner.
    for (let k = 0; k < grid.length; k++) out[k] = 1e3 * scene.step * grid[k];
    return out;
  };

  const linear = (rgb) => {
    const colour = new THREE.Color().setRGB(...rgb, THREE.SRGBColorSpace);
    return [colour.r, colour.g, colour.b];
  };
  const INKS = [linear(FABRIC), linear(PRINTED)];
  const LOOKUP = Array.from({ length: 256 }, (_, k) => {
    const place = (k / 255) * (SCALE.length - 1), low = Math.min(Math.floor(place), SCALE.length - 2);
    const colour = new THREE.Color(SCALE[low]).lerp(new THREE.Color(SCALE[low + 1]), place - low);
    return [colour.r, colour.g, colour.b];
  });

  /* Corners of all polygons that are drawn: each lies in a triangle, at three weights. */
  class Corners {
    constructor(skin, cells, weights, inks, index) {
      Object.assign(this, { skin, cells, weights, inks });
      const geometry = new THREE.BufferGeometry(), count = cells.length;
      for (const name of ["position", "normal", "color"])
        geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(3 * count), 3));
      geometry.setIndex(new THREE.BufferAttribute(index, 1));
      this.geometry = geometry;
    }

    update(positions, normals, colour) {
      const { cells, weights, skin } = this, { triangles } = skin;
      const place = this.geometry.attributes.position.array;
      const normal = this.geometry.attributes.normal.array;
      const ink = this.geometry.attributes.color.array;
      for (let k = 0; k < cells.length; k++) {
        const cell = cells[k];
        for (let axis = 0; axis < 3; axis++) {
          let x = 0, n = 0;
          for (let c = 0; c < 3; c++) {
            const w = weights[3 * k + c];
            x += w * positions[3 * triangles[3 * cell + c] + axis];
            n += w * normals[9 * cell + 3 * c + axis];
          }
          place[3 * k + axis] = x;
          normal[3 * k + axis] = n;
        }
        const rgb = colour(k, cell);
        ink[3 * k] = rgb[0]; ink[3 * k + 1] = rgb[1]; ink[3 * k + 2] = rgb[2];
      }
      for (const name of ["position", "normal", "color"])
        this.geometry.attributes[name].needsUpdate = true;
      this.geometry.computeBoundingSphere();
    }
  }

  function wholeTriangles(skin) {
    const count = skin.triangles.length, weights = new Float32Array(3 * count);
    const cells = new Uint32Array(count), index = new Uint32Array(count);
    for (let k = 0; k < count; k++) {
      cells[k] = Math.floor(k / 3);
      weights[3 * k + (k % 3)] = 1;
      index[k] = k;
    }
    return new Corners(skin, cells, weights, null, index);
  }

  /* The polygons of the print and those beside it; triangles that no print reaches are bare. */
  function printedTriangles(skin, read, packed) {
    const cell = read(packed.cells), inside = read(packed.inside), polygon = read(packed.polygons);
    const counts = read(packed.counts), two = read(packed.weights), total = two.length / 2;
    const reached = new Uint8Array(skin.triangles.length / 3);
    for (const c of cell) reached[c] = 1;
    const bare = [];
    reached.forEach((yes, c) => { if (!yes) bare.push(c); });
    const size = total + 3 * bare.length;
    const cells = new Uint32Array(size), inks = new Uint8Array(size);
    const weights = new Float32Array(3 * size), index = [];
    for (let k = 0; k < total; k++) {
      const u = two[k] / 65535, v = two[total + k] / 65535;
      weights.set([1 - u - v, u, v], 3 * k);
    }
    const place = (k) => new THREE.Vector2(weights[3 * k + 1], weights[3 * k + 2]);
    let first = 0, ring = 0;
    for (let p = 0; p < cell.length; p++) {
      const rings = [], begin = first;
      for (; ring < polygon.length && polygon[ring] === p; ring++) {
        rings.push(Array.from({ length: counts[ring] }, (_, k) => place(first + k)));
        first += counts[ring];
      }
      for (let k = begin; k < first; k++) { cells[k] = cell[p]; inks[k] = inside[p]; }
      const points = rings.flat();
      for (const [a, b, c] of THREE.ShapeUtils.triangulateShape(rings[0], rings.slice(1))) {
        const [i, j, k] = [points[a], points[b], points[c]];
        const area = (j.x - i.x) * (k.y - i.y) - (j.y - i.y) * (k.x - i.x);
        index.push(begin + a, begin + (area > 0 ? b : c), begin + (area > 0 ? c : b));
      }
    }
    bare.forEach((c, k) => {
      for (let corner = 0; corner < 3; corner++) {
        const here = total + 3 * k + corner;
        cells[here] = c;
        weights[3 * here + corner] = 1;
        index.push(here);
      }
    });
    return new Corners(skin, cells, weights, inks, Uint32Array.from(index));
  }

  class Skin {
    constructor(read, packed) {
      this.triangles = read(packed.triangles);
      this.seams = read(packed.seams);
      this.vertices = packed.vertices;
      this.closed = packed.closed;
      this.plain = wholeTriangles(this);
      this.printed = packed.print ? printedTriangles(this, read, packed.print) : null;
      this.border = packed.border
        ? { cells: read(packed.border.cells), weights: read(packed.border.weights) } : null;
      this.target = packed.target ? placed(read(packed.target)) : null;
      this.body = packed.body
        ? { points: placed(read(packed.body.points)), triangles: read(packed.body.triangles) } : null;
      // Triangles around each vertex.
      this.first = new Uint32Array(this.vertices + 1);
      for (const v of this.triangles) this.first[v + 1]++;
      for (let v = 0; v < this.vertices; v++) this.first[v + 1] += this.first[v];
      this.around = new Uint32Array(this.triangles.length);
      const next = this.first.slice();
      this.triangles.forEach((v, k) => { this.around[next[v]++] = Math.floor(k / 3); });
    }

    edges() {
      if (!this.found) {
        const pairs = new Set(), t = this.triangles, n = this.vertices;
        for (let k = 0; k < t.length; k++) {
          const a = t[k], b = t[k % 3 === 2 ? k - 2 : k + 1];
          pairs.add(Math.min(a, b) * n + Math.max(a, b));
        }
        this.found = Uint32Array.from([...pairs].flatMap((p) => [Math.floor(p / n), p % n]));
      }
      return this.found;
    }

    /* Normals of the triangles times twice their areas, (t, 3). */
    faces(x) {
      const t = this.triangles, out = new Float32Array(t.length);
      for (let k = 0; k < t.length; k += 3) {
        const a = 3 * t[k], b = 3 * t[k + 1], c = 3 * t[k + 2];
        const ux = x[b] - x[a], uy = x[b + 1] - x[a + 1], uz = x[b + 2] - x[a + 2];
        const vx = x[c] - x[a], vy = x[c + 1] - x[a + 1], vz = x[c + 2] - x[a + 2];
        out[k] = uy * vz - uz * vy; out[k + 1] = uz * vx - ux * vz; out[k + 2] = ux * vy - uy * vx;
      }
      return out;
    }

    /* Normals at the corners of the triangles, smooth except across edges, (t, 3, 3). */
    normals(x) {
      const face = this.faces(x), t = this.triangles, out = new Float32Array(3 * t.length);
      const length = (k) => Math.hypot(face[k], face[k + 1], face[k + 2]) || 1;
      for (let k = 0; k < t.length; k++) {
        const own = 3 * Math.floor(k / 3), size = length(own);
        let nx = 0, ny = 0, nz = 0;
        for (let j = this.first[t[k]]; j < this.first[t[k] + 1]; j++) {
          const f = 3 * this.around[j];
          const dot = face[own] * face[f] + face[own + 1] * face[f + 1] + face[own + 2] * face[f + 2];
          if (dot >= SMOOTH * size * length(f)) { nx += face[f]; ny += face[f + 1]; nz += face[f + 2]; }
        }
        const norm = Math.hypot(nx, ny, nz) || 1;
        out[3 * k] = nx / norm; out[3 * k + 1] = ny / norm; out[3 * k + 2] = nz / norm;
      }
      return out;
    }
  }

  function viewer(skins) {
    const canvas = at("canvas"), stage = at("stage");
    const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    const world = new THREE.Scene(), camera = new THREE.PerspectiveCamera(28, 1, 1, 1e4);
    camera.up.set(0, 0, 1);
    const light = new THREE.DirectionalLight(0xffffff, 1.5);
    light.position.set(-0.35, 0.45, 0.82);
    camera.add(light);
    world.add(camera, new THREE.AmbientLight(0xffffff, 1.6));
    const controls = new THREE.OrbitControls(camera, canvas);
    const surface = new THREE.MeshLambertMaterial({ vertexColors: true, polygonOffset: true,
      polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
    const mesh = new THREE.Mesh(new THREE.BufferGeometry(), surface);
    const green = new THREE.Color(...linear(TARGET));
    const solid = (opacity) => new THREE.Mesh(new THREE.BufferGeometry(),
      new THREE.MeshLambertMaterial({ color: green, transparent: opacity < 1, opacity,
        depthWrite: opacity === 1, side: THREE.DoubleSide }));
    const target = solid(0.4), body = solid(1);
    // The target often lies inside of the skin: it is drawn over it.
    target.material.depthTest = false;
    target.material.side = THREE.FrontSide;
    target.renderOrder = 1;
    const strokes = (colour, opacity) => new THREE.LineSegments(new THREE.BufferGeometry(),
      new THREE.LineBasicMaterial({ color: colour, transparent: opacity < 1, opacity }));
    const border = strokes(0x10182a, 1), seams = strokes(0x7a4a1c, 1), edges = strokes(0x303a48, 0.35);
    for (const part of [mesh, target, body, border, seams, edges]) part.frustumCulled = false;
    world.add(mesh, body, border, seams, edges, target);

    let pending = false;
    function render() {
      pending = false;
      renderer.render(world, camera);
      drawScale();
    }
    function soon() {
      if (!pending) { pending = true; requestAnimationFrame(render); }
    }
    controls.addEventListener("change", soon);

    function resize() {
      const { width, height } = stage.getBoundingClientRect();
      if (!width || !height) return;
      renderer.setSize(width, height, false);
      camera.aspect = width / height;
      camera.updateProjectionMatrix();
      soon();
    }
    new ResizeObserver(() => { resize(); if (!touched) fit(); }).observe(stage);
    let touched = false, framed = null, direction = new THREE.Vector3(0.6, -1, 0.5);
    controls.addEventListener("start", () => { touched = true; });

    /* Put the camera so that the points fill the picture, seen from the direction. */
    function fit() {
      if (!framed) return;
      const toward = direction.clone().normalize();
      const right = new THREE.Vector3().crossVectors(camera.up, toward).normalize();
      const upward = new THREE.Vector3().crossVectors(toward, right);
      const point = new THREE.Vector3(), low = [Infinity, Infinity, Infinity];
      const high = low.map((x) => -x);
      const along = (k) => {
        point.fromArray(framed, k);
        return [point.dot(right), point.dot(upward), point.dot(toward)];
      };
      for (let k = 0; k < framed.length; k += 3) along(k).forEach((x, axis) => {
        low[axis] = Math.min(low[axis], x); high[axis] = Math.max(high[axis], x);
      });
      const middle = low.map((x, axis) => (x + high[axis]) / 2);
      const vertical = Math.tan((camera.fov * Math.PI) / 360) * 0.86;
      const horizontal = vertical * camera.aspect;
      let distance = 0;
      for (let k = 0; k < framed.length; k += 3) {
        const [x, y, z] = along(k);
        distance = Math.max(distance, z - middle[2] + Math.abs(x - middle[0]) / horizontal,
          z - middle[2] + Math.abs(y - middle[1]) / vertical);
      }
      controls.target.set(0, 0, 0).addScaledVector(right, middle[0])
        .addScaledVector(upward, middle[1]).addScaledVector(toward, middle[2]);
      camera.position.copy(controls.target).addScaledVector(toward, distance);
      camera.near = distance / 100;
      camera.far = distance * 10;
      camera.updateProjectionMatrix();
      controls.update();
      touched = false;
      soon();
    }

    function drawScale() {
      const distance = camera.position.distanceTo(controls.target);
      const perPixel = (2 * distance * Math.tan((camera.fov * Math.PI) / 360)) / stage.clientHeight;
      const most = perPixel * 130, power = 10 ** Math.floor(Math.log10(most));
      const length = power * [5, 2, 1].find((k) => k * power <= most);
      at("scale").children[0].textContent = `${+length.toPrecision(1)} mm`;
      at("scale").children[1].style.width = `${length / perPixel}px`;
    }

    function segments(part, positions, pairs) {
      const out = new Float32Array(3 * pairs.length);
      for (let k = 0; k < pairs.length; k++)
        for (let axis = 0; axis < 3; axis++) out[3 * k + axis] = positions[3 * pairs[k] + axis];
      part.geometry.setAttribute("position", new THREE.BufferAttribute(out, 3));
    }

    /* The print's borders: two ends for each piece, in one triangle. */
    function contours(part, positions, { border: { cells, weights }, triangles }) {
      const count = 2 * cells.length, out = new Float32Array(3 * count);
      for (let k = 0; k < count; k++) {
        const u = weights[k] / 65535, v = weights[count + k] / 65535, first = 3 * cells[k >> 1];
        const [a, b, c] = [0, 1, 2].map((corner) => 3 * triangles[first + corner]);
        for (let axis = 0; axis < 3; axis++)
          out[3 * k + axis] = (1 - u - v) * positions[a + axis] + u * positions[b + axis]
            + v * positions[c + axis];
      }
      part.geometry.setAttribute("position", new THREE.BufferAttribute(out, 3));
    }

    function setBody(part, points, triangles) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(points, 3));
      geometry.setIndex(new THREE.BufferAttribute(Uint32Array.from(triangles), 1));
      geometry.computeVertexNormals();
      part.geometry.dispose();
      part.geometry = geometry;
    }

    /* Come no nearer than that the points stay in the picture, unless a reader chose the view. */
    function keepInside(points) {
      if (touched || !framed) return;
      const point = new THREE.Vector3();
      camera.updateMatrixWorld();
      for (let k = 0; k < points.length; k += 3) {
        point.fromArray(points, k).project(camera);
        if (Math.abs(point.x) > 0.98 || Math.abs(point.y) > 0.98) {
          const both = new Float32Array(framed.length + points.length);
          both.set(framed);
          both.set(points, framed.length);
          framed = both;
          fit();
          return;
        }
      }
    }

    let shown = null;
    /* Show a frame; return the range of its colours, or null. */
    function show(frame, colour) {
      const skin = skins[frame.skin], positions = placed(frame.positions);
      const corners = frame.density || !skin.printed ? skin.plain : skin.printed;
      let range = null, paint;
      if (colour === "stretch") {
        range = [...frame.stretch_range];
        if (range[1] - range[0] < 0.01) range[1] = range[0] + 0.01;
        paint = (_, cell) => LOOKUP[Math.max(0, Math.min(255,
          Math.round((255 * (frame.stretch[cell] / 100 - range[0])) / (range[1] - range[0]))))];
      } else if (colour === "distance" && skin.target) {
        const far = new Float32Array(skin.vertices);
        for (let v = 0; v < skin.vertices; v++)
          far[v] = Math.hypot(positions[3 * v] - skin.target[3 * v],
            positions[3 * v + 1] - skin.target[3 * v + 1], positions[3 * v + 2] - skin.target[3 * v + 2]);
        range = [0, Math.max(1e-3, far.reduce((a, b) => Math.max(a, b), 0))];
        paint = (k, cell) => {
          let value = 0;
          for (let c = 0; c < 3; c++)
            value += corners.weights[3 * k + c] * far[skin.triangles[3 * cell + c]];
          return LOOKUP[Math.max(0, Math.min(255, Math.round((255 * value) / range[1])))];
        };
      } else if (frame.density) {
        const mixed = INKS[0].map((_, c) => (d) => INKS[0][c] + d * (INKS[1][c] - INKS[0][c]));
        paint = (_, cell) => mixed.map((mix) => mix(frame.density[cell] / 255));
      } else {
        paint = (k) => INKS[corners.inks ? corners.inks[k] : 0];
      }
      corners.update(positions, skin.normals(positions), paint);
      mesh.geometry = corners.geometry;
      const side = skin.closed ? THREE.FrontSide : THREE.DoubleSide;
      if (surface.side !== side) { surface.side = side; surface.needsUpdate = true; }
      border.visible = range !== null && corners === skin.printed;
      if (border.visible) contours(border, positions, skin);
      if (shown !== skin) {
        if (skin.target) setBody(target, skin.target, skin.triangles);
        if (skin.body) setBody(body, skin.body.points, skin.body.triangles);
        shown = skin;
      }
      target.visible = at("target").checked && skin.target !== null;
      body.visible = at("body").checked && skin.body !== null;
      seams.visible = at("seams").checked;
      edges.visible = at("mesh").checked;
      keepInside(positions);
      if (target.visible) keepInside(skin.target);
      if (seams.visible) segments(seams, positions, skin.seams);
      if (edges.visible) segments(edges, positions, skin.edges());
      soon();
      return range;
    }

    /* The direction from which most of the print, and of the shape, is to be seen. */
    function bestDirection(frame) {
      const skin = skins[frame.skin], positions = placed(frame.positions);
      const faces = skin.faces(positions), ink = new Float32Array(faces.length / 3);
      if (frame.density) frame.density.forEach((d, c) => { ink[c] = d / 255; });
      else if (skin.printed) skin.printed.inks.forEach((d, k) => { ink[skin.printed.cells[k]] = Math.max(ink[skin.printed.cells[k]], d); });
      let best = -1, found = null;
      for (const tilt of [0.35, -0.3]) for (let turn = 0; turn < 16; turn++) {
        // Never along an axis of symmetry, where depth would not be seen.
        const angle = ((turn + 0.5) / 16) * 2 * Math.PI;
        const d = new THREE.Vector3(Math.cos(angle), Math.sin(angle), tilt).normalize();
        const right = new THREE.Vector3().crossVectors(camera.up, d).normalize();
        const upward = new THREE.Vector3().crossVectors(d, right);
        let score = 0;
        for (let c = 0; c < ink.length; c++) {
          const facing = faces[3 * c] * d.x + faces[3 * c + 1] * d.y + faces[3 * c + 2] * d.z;
          if (facing > 0) score += facing * (0.3 + ink[c]);
        }
        const spread = [right, upward].map((axis) => {
          let low = Infinity, high = -Infinity;
          for (let k = 0; k < positions.length; k += 3) {
            const x = positions[k] * axis.x + positions[k + 1] * axis.y + positions[k + 2] * axis.z;
            low = Math.min(low, x); high = Math.max(high, x);
          }
          return high - low;
        });
        score *= Math.sqrt(spread[0] * spread[1]) * (tilt > 0 ? 1.15 : 1);
        if (score > best) { best = score; found = d; }
      }
      return found;
    }

    resize();
    return {
      show,
      look(from) { direction = from; fit(); },
      /* Frame points, (3 n), from the best direction for a frame. */
      frame(points, frame) { framed = points; direction = bestDirection(frame); fit(); },
    };
  }

  function start(bytes) {
    const read = reader(bytes), skins = {};
    for (const [name, packed] of Object.entries(scene.skins)) skins[name] = new Skin(read, packed);
    for (const entries of Object.values(scene.series)) unpackSeries(read, entries);
    let view;
    try {
      view = viewer(skins);
    } catch (error) {
      say(`The view in space needs WebGL, which this browser does not offer: ${error.message}`);
      return;
    }
    const names = Object.keys(scene.series), current = {}, sliders = {};
    let series = scene.start.series, playing = null;

    const colour = () => document.querySelector("input[name=colour]:checked").value;
    /* What the camera is placed for: a frame, and the body beside it. */
    function around(frame) {
      const positions = placed(frame.positions), { body } = skins[frame.skin];
      if (!body) return positions;
      const out = new Float32Array(positions.length + body.points.length);
      out.set(positions);
      out.set(body.points, positions.length);
      return out;
    }

    function update() {
      const frame = scene.series[series][current[series]], skin = skins[frame.skin];
      at("with-target").hidden = !skin.target;
      at("with-body").hidden = !skin.body;
      const distance = document.querySelector("input[value=distance]");
      distance.parentElement.hidden = !skin.target;
      if (!skin.target && distance.checked) document.querySelector("input[value=print]").checked = true;
      const mode = colour(), range = view.show(frame, mode);
      at("caption").textContent = series === "iteration" ? `iteration ${frame.label}` : frame.label;
      at("bar").hidden = range === null;
      if (range) {
        const unit = mode === "distance" ? " mm" : "";
        at("bar-title").textContent = mode === "distance" ? "distance from the target (mm)"
          : "largest principal stretch";
        at("bar-colours").style.background = `linear-gradient(to right, ${SCALE.join(",")})`;
        const marks = [0, 0.5, 1].map((part) => range[0] + part * (range[1] - range[0]));
        at("bar-marks").replaceChildren(...marks.map((value) => {
          const mark = document.createElement("span");
          mark.textContent = `${+value.toPrecision(3)}${unit}`;
          return mark;
        }));
      }
      at("values").replaceChildren(...frame.shown.map(([name, value]) => {
        const row = document.createElement("div");
        row.append(document.createElement("dt"), document.createElement("dd"));
        row.children[0].textContent = name;
        row.children[1].textContent = value;
        return row;
      }));
      at("note").textContent = frame.note;
      at("note").hidden = !frame.note;
      for (const name of names) {
        sliders[name].classList.toggle("now", name === series);
        const entry = scene.series[name][current[name]];
        sliders[name].querySelector("b").textContent = entry.label;
      }
      for (const chart of document.querySelectorAll("svg.chart")) {
        const line = chart.querySelector(".now"), data = chart.dataset;
        const entry = chart.dataset.series === series ? frame : null;
        const part = entry ? (entry.x - data.low) / (data.high - data.low) : -1;
        const x = part >= 0 && part <= 1 ? +data.left + part * (data.right - data.left) : -9;
        line.setAttribute("x1", x);
        line.setAttribute("x2", x);
      }
    }

    function choose(name, index) {
      if (name !== series) {
        const before = series;
        series = name;
        if (scene.frame_of[name] !== scene.frame_of[before]) view.frame(around(last(name)), last(name));
      }
      current[name] = index;
      update();
    }
    const last = (name) => scene.series[name][scene.series[name].length - 1];

    function stop() {
      clearInterval(playing);
      playing = null;
      for (const button of document.querySelectorAll(".slider input:not([hidden]) + button"))
        button.textContent = "▶";
    }

    for (const name of names) {
      const count = scene.series[name].length;
      current[name] = name === scene.start.series ? scene.start.index : count - 1;
      const row = document.createElement("div");
      row.className = "slider";
      row.innerHTML = "<span><label></label><b></b></span><input type=\"range\" min=\"0\">"
        + "<button type=\"button\">▶</button>";
      const [input, button] = [row.querySelector("input"), row.querySelector("button")];
      row.querySelector("label").textContent = WORDS[name];
      row.querySelector("label").htmlFor = input.id = `slider-${name}`;
      input.max = count - 1;
      input.value = current[name];
      input.hidden = count < 2;
      input.addEventListener("input", () => { stop(); choose(name, +input.value); });
      input.addEventListener("pointerdown", () => { if (name !== series) choose(name, +input.value); });
      button.setAttribute("aria-label", `play over ${WORDS[name]}`);
      if (count < 2) button.textContent = "show";
      button.addEventListener("click", () => {
        if (count < 2) { stop(); choose(name, 0); return; }
        const again = playing !== null && series === name;
        stop();
        if (again) return;
        button.textContent = "❚❚";
        playing = setInterval(() => {
          const next = (current[name] + 1) % count;
          input.value = next;
          choose(name, next);
        }, Math.max(60, Math.min(400, 6000 / count)));
      });
      row.addEventListener("click", (event) => {
        if (event.target.tagName === "LABEL" && name !== series) choose(name, current[name]);
      });
      sliders[name] = row;
      at("sliders").append(row);
    }
    for (const input of document.querySelectorAll("#colours input, #switches input"))
      input.addEventListener("change", update);
    for (const button of document.querySelectorAll("#views button"))
      button.addEventListener("click", () => {
        const frame = scene.series[series][current[series]];
        if (button.dataset.best !== undefined) view.frame(around(frame), frame);
        else view.look(new THREE.Vector3(...button.dataset.from.split(",").map(Number)));
      });
    at("resolution").textContent = scene.resolution;
    const first = scene.series[series][current[series]];
    view.frame(around(first), first);
    update();
    requestAnimationFrame(() => requestAnimationFrame(() => {
      document.documentElement.dataset.state = "ready";
    }));
  }

  if (!scene.start) {
    at("view").hidden = true;
    document.documentElement.dataset.state = "ready";
    return;
  }
  if (typeof DecompressionStream === "undefined") {
    say("This browser is too old for the view in space; it needs Chromium 80, Firefox 113 or Safari 16.4.");
    return;
  }
  unpack(at("data").textContent).then(start).catch((error) => {
    say(`The view in space could not be drawn: ${error.message}`);
    throw error;
  });
})();
