"use strict";
(() => {
  const INKS = ["#ebdfc8", "#1f3a5f"], ACCENT = "#d55e00", BODY = "#9aa5b1", BORDER = "#10182a";
  // Colours of equal steps of lightness, seen by all eyes alike (cividis, by Nuñez, Anderton, Renslow; CC0).
  const SCALE = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74",
    "#c3b369", "#e1cc55", "#fee838"];
  // Faces that meet at a larger angle have an edge between them.
  const SMOOTH = Math.cos((40 * Math.PI) / 180);
  // Least width in mm, and largest width in pixels, of what a pixel of the print's texture shows.
  const TEXEL = 0.05, TEXELS = 4096;
  // Width of the target's outline in pixels, and height of the picture over that of what it shows.
  const OUTLINE = 2, MARGIN = 1.16;
  const WORDS = { pressure: "pressure", iteration: "design iteration", gait: "gait",
    pose: "pose", load: "on the object" };
  const at = (id) => document.getElementById(id);
  const scene = JSON.parse(at("scene").textContent);

  function say(text) {
    at("message").textContent = text;
    at("message").hidden = false;
    document.documentElement.dataset.state = "failed";
  }

  async function unpack(text) {
    const letters = atob(text), raw = new Uint8Array(letters.length);
    for (let k = 0; k < raw.length; k++) raw[k] = letters.charCodeAt(k);
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

  // In mm, from the box's corner.
  const placed = (grid) => Float32Array.from(grid, (x) => 1e3 * scene.step * x);
  const linear = (colour) => new THREE.Color(colour).toArray();
  const between = (a, b, part) => a.map((x, c) => x + part * (b[c] - x));
  const FABRIC = linear(INKS[0]), PRINTED = linear(INKS[1]), STOPS = SCALE.map(linear);
  const LOOKUP = Array.from({ length: 256 }, (_, k) => {
    const place = (k / 255) * (STOPS.length - 1), low = Math.min(Math.floor(place), STOPS.length - 2);
    return between(STOPS[low], STOPS[low + 1], place - low);
  });
  const colourOf = (part) => LOOKUP[Math.max(0, Math.min(255, Math.round(255 * part)))];

  /* The print of a flat pattern, painted on fabric, or its borders alone, painted on white. */
  function texture(drawing, anisotropy, borders) {
    const { width, height } = drawing.dataset, canvas = document.createElement("canvas");
    const scale = Math.min(1 / TEXEL, TEXELS / Math.max(width, height));
    canvas.width = Math.ceil(scale * width);
    canvas.height = Math.ceil(scale * height);
    const ctx = canvas.getContext("2d");
    ctx.fillStyle = borders ? "#ffffff" : INKS[0];
    ctx.fillRect(0, 0, canvas.width, canvas.height);
    ctx.fillStyle = ctx.strokeStyle = borders ? BORDER : INKS[1];
    for (const panel of drawing.querySelectorAll("g")) {
      const { x, y } = panel.dataset;
      const [cut, print] = ["cut", "print"].map((name) =>
        new Path2D(panel.querySelector(`.${name}`).getAttribute("d")));
      ctx.setTransform(canvas.width / width, 0, 0, -canvas.height / height,
        (x * canvas.width) / width, (y * canvas.height) / height);
      ctx.save();
      if (borders) {
        ctx.clip(cut);
        ctx.lineWidth = 6 / scale;
        ctx.stroke(print);
      } else {
        ctx.fill(print, "evenodd");
        // Beyond a panel's border too, so that no fabric shines through along a printed seam.
        const beyond = new Path2D();
        beyond.rect(-x, y - height, width, height);
        beyond.addPath(cut);
        ctx.clip(beyond, "evenodd");
        ctx.lineWidth = 8 / scale;
        ctx.stroke(print);
      }
      ctx.restore();
    }
    return Object.assign(new THREE.CanvasTexture(canvas), { anisotropy, colorSpace: THREE.SRGBColorSpace });
  }

  class Skin {
    constructor(read, packed) {
      Object.assign(this, { vertices: packed.vertices, closed: packed.closed, pattern: packed.pattern });
      const flat = read(packed.triangles), sewn = read(packed.sewn);
      this.triangles = flat.map((point) => sewn[point]);
      this.seams = read(packed.seams);
      this.target = packed.target ? placed(read(packed.target)) : null;
      this.grounds = packed.grounds;
      this.body = packed.body
        ? { points: placed(read(packed.body.points)), triangles: read(packed.body.triangles) } : null;
      // Triangles around each vertex.
      this.first = new Uint32Array(this.vertices + 1);
      for (const v of this.triangles) this.first[v + 1]++;
      for (let v = 0; v < this.vertices; v++) this.first[v + 1] += this.first[v];
      this.around = new Uint32Array(this.triangles.length);
      const next = this.first.slice();
      this.triangles.forEach((v, k) => { this.around[next[v]++] = Math.floor(k / 3); });
      // Each corner of a triangle is a vertex of the geometry.
      this.geometry = new THREE.BufferGeometry();
      for (const name of ["position", "normal", "color"])
        this.geometry.setAttribute(name,
          new THREE.BufferAttribute(new Float32Array(3 * this.triangles.length), 3));
      if (packed.places) {
        const places = read(packed.places), uv = new Float32Array(2 * flat.length);
        flat.forEach((point, k) => {
          for (let c = 0; c < 2; c++) uv[2 * k + c] = places[2 * point + c] / 65535;
        });
        this.geometry.setAttribute("uv", new THREE.BufferAttribute(uv, 2));
      }
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

    /* Normals at the corners of the triangles, smooth except across sharp edges, (t, 3, 3). */
    normals(x) {
      const face = this.faces(x), t = this.triangles, out = new Float32Array(3 * t.length);
      const length = (k) => Math.hypot(face[k], face[k + 1], face[k + 2]) || 1;
      for (let k = 0; k < t.length; k++) {
        const own = 3 * Math.floor(k / 3), size = length(own), sum = [0, 0, 0];
        for (let j = this.first[t[k]]; j < this.first[t[k] + 1]; j++) {
          const f = 3 * this.around[j];
          const dot = face[own] * face[f] + face[own + 1] * face[f + 1] + face[own + 2] * face[f + 2];
          if (dot >= SMOOTH * size * length(f)) for (let c = 0; c < 3; c++) sum[c] += face[f + c];
        }
        const norm = Math.hypot(...sum) || 1;
        for (let c = 0; c < 3; c++) out[3 * k + c] = sum[c] / norm;
      }
      return out;
    }

    /* Put the geometry at positions, with a colour for each corner k of the triangle k / 3. */
    update(positions, paint) {
      const { position, normal, color } = this.geometry.attributes;
      normal.array.set(this.normals(positions));
      this.triangles.forEach((v, k) => {
        position.array.set(positions.subarray(3 * v, 3 * v + 3), 3 * k);
        color.array.set(paint(k), 3 * k);
      });
      for (const part of [position, normal, color]) part.needsUpdate = true;
    }
  }

  function viewer(skins) {
    const canvas = at("canvas"), stage = at("stage");
    const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, stencil: true });
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    const world = new THREE.Scene(), camera = new THREE.OrthographicCamera();
    camera.up.set(0, 0, 1);
    const light = new THREE.DirectionalLight(0xffffff, 1.5);
    light.position.set(-0.35, 0.45, 0.82);
    camera.add(light);
    world.add(camera, new THREE.AmbientLight(0xffffff, 1.6));
    const controls = new THREE.OrbitControls(camera, canvas);
    const make = (Part, Material, look) => {
      const part = new Part(new THREE.BufferGeometry(), new Material(look));
      part.frustumCulled = false;
      world.add(part);
      return part;
    };
    const solid = (look) => make(THREE.Mesh, THREE.MeshLambertMaterial, look);
    const mesh = solid({ vertexColors: true, polygonOffset: true, polygonOffsetFactor: 1,
      polygonOffsetUnits: 1 });
    const surface = mesh.material, body = solid({ color: BODY, side: THREE.DoubleSide });
    const ground = solid({ color: BODY, transparent: true, opacity: 0.35 }); // seen from above
    const seams = make(THREE.LineSegments, THREE.LineBasicMaterial, { color: "#7a4a1c" });
    const edges = solid({ color: 0, emissive: "#303a48", wireframe: true, transparent: true,
      opacity: 0.35 });
    // The target's outline: what the target covers where it is moved a little, but not where it
    // is. It often lies inside of the skin, and so it is drawn over it.
    const over = { depthTest: false, depthWrite: false, side: THREE.DoubleSide, stencilWrite: true,
      stencilRef: 1 };
    const target = solid({ ...over, colorWrite: false, stencilZPass: 7681 });
    const rim = { ...over, color: 0, emissive: ACCENT, stencilFunc: 517 };
    const outline = Array.from({ length: 8 }, () => solid(rim));
    [target, ...outline].forEach((part) => { part.renderOrder = part === target ? 1 : 2; });
    const textures = new Map(), most = renderer.capabilities.getMaxAnisotropy();
    const painted = (number, borders) => {
      const key = `${number} ${borders}`;
      if (!textures.has(key))
        textures.set(key, texture(document.querySelectorAll("svg.flat")[number], Math.min(8, most), borders));
      return textures.get(key);
    };

    let pending = false, touched = false, framed = null, direction = null, shown = null;
    function render() {
      pending = false;
      const width = OUTLINE * drawScale();
      outline.forEach((part, k) => {
        const angle = (2 * Math.PI * k) / outline.length;
        part.position.set(width * Math.cos(angle), width * Math.sin(angle), 0)
          .applyQuaternion(camera.quaternion);
      });
      renderer.render(world, camera);
    }
    function soon() {
      if (!pending) { pending = true; requestAnimationFrame(render); }
    }
    controls.addEventListener("change", soon);
    controls.addEventListener("start", () => { touched = true; });

    function resize() {
      const { width, height } = stage.getBoundingClientRect();
      if (!width || !height) return;
      renderer.setSize(width, height, false);
      [camera.left, camera.right] = [-1, 1].map((side) => (side * camera.top * width) / height);
      camera.updateProjectionMatrix();
      soon();
    }
    new ResizeObserver(() => { if (touched) resize(); else fit(); }).observe(stage);

    /* Put the camera so that the points fill the picture, seen from the direction. */
    function fit() {
      if (!framed) return;
      const toward = direction.clone().normalize(), point = new THREE.Vector3();
      const right = new THREE.Vector3().crossVectors(camera.up, toward).normalize();
      const [x, y, z] = [right, new THREE.Vector3().crossVectors(toward, right), toward].map((axis) => {
        let low = Infinity, high = -Infinity;
        for (let k = 0; k < framed.length; k += 3) {
          const place = point.fromArray(framed, k).dot(axis);
          low = Math.min(low, place); high = Math.max(high, place);
        }
        return { axis, middle: (low + high) / 2, half: (high - low) / 2 };
      });
      const { clientWidth: width, clientHeight: height } = stage;
      const top = MARGIN * Math.max(y.half, (x.half * height) / width), far = 10 * (top + z.half);
      controls.target.set(0, 0, 0);
      for (const { axis, middle } of [x, y, z]) controls.target.addScaledVector(axis, middle);
      camera.position.copy(controls.target).addScaledVector(toward, far);
      Object.assign(camera, { top, bottom: -top, near: 0, far: 2 * far, zoom: 1 });
      resize();
      controls.update();
      touched = false;
      soon();
    }

    /* Draw the bar of a round length; return the length of a pixel in mm. */
    function drawScale() {
      const perPixel = (2 * camera.top) / camera.zoom / stage.clientHeight;
      const most = perPixel * 130, power = 10 ** Math.floor(Math.log10(most));
      const length = power * [5, 2, 1].find((k) => k * power <= most);
      at("scale").children[0].textContent = `${+length.toPrecision(1)} mm`;
      at("scale").children[1].style.width = `${length / perPixel}px`;
      return perPixel;
    }

    function setPoints(part, points, index) {
      part.geometry.setAttribute("position", new THREE.BufferAttribute(points, 3));
      part.geometry.setIndex(new THREE.BufferAttribute(Uint32Array.from(index), 1));
      if (part.isMesh) part.geometry.computeVertexNormals();
    }

    function take(skin) {
      mesh.geometry = edges.geometry = skin.geometry;
      const side = skin.closed ? THREE.FrontSide : THREE.DoubleSide;
      if (surface.side !== side) { surface.side = side; surface.needsUpdate = true; }
      if (skin.body) setPoints(body, skin.body.points, skin.body.triangles);
      setPoints(ground, Float32Array.from(skin.grounds), skin.grounds.map((_, k) => k));
      if (skin.target) setPoints(target, skin.target, skin.triangles);
      for (const part of outline) part.geometry = target.geometry;
      shown = skin;
    }

    /* Come no nearer than that the points stay in the picture, unless a reader chose the view. */
    function keepInside(points) {
      if (touched || !framed) return;
      const point = new THREE.Vector3();
      camera.updateMatrixWorld();
      for (let k = 0; k < points.length; k += 3) {
        point.fromArray(points, k).project(camera);
        if (Math.abs(point.x) < 0.98 && Math.abs(point.y) < 0.98) continue;
        framed = Float32Array.from([...framed, ...points]);
        fit();
        return;
      }
    }

    /* Show a frame; return the range of its colours, or null. */
    function show(frame, colour) {
      const skin = skins[frame.skin], positions = placed(frame.positions);
      let range = null, paint = () => FABRIC;
      const printed = skin.pattern !== undefined && !frame.density;
      if (colour === "stretch") {
        const [low, high] = frame.stretch_range;
        range = [low, Math.max(high, low + 0.01)];
        paint = (k) => colourOf((frame.stretch[Math.floor(k / 3)] / 100 - low) / (range[1] - low));
      } else if (colour === "distance" && skin.target) {
        const far = new Float32Array(skin.vertices).map((_, v) => Math.hypot(
          ...[0, 1, 2].map((c) => positions[3 * v + c] - skin.target[3 * v + c])));
        range = [0, far.reduce((a, b) => Math.max(a, b), 1e-3)];
        paint = (k) => colourOf(far[skin.triangles[k]] / range[1]);
      } else if (frame.density) {
        paint = (k) => between(FABRIC, PRINTED, frame.density[Math.floor(k / 3)] / 255);
      } else if (printed) {
        paint = () => [1, 1, 1];
      }
      const map = printed ? painted(skin.pattern, range !== null) : null;
      if (surface.map !== map) { surface.map = map; surface.needsUpdate = true; }
      skin.update(positions, paint);
      if (shown !== skin) take(skin);
      for (const part of [target, ...outline])
        part.visible = at("target").checked && skin.target !== null;
      body.visible = at("body").checked && skin.body !== null;
      ground.visible = at("body").checked && skin.grounds.length > 0;
      seams.visible = at("seams").checked;
      edges.visible = at("mesh").checked;
      keepInside(positions);
      if (target.visible) keepInside(skin.target);
      if (seams.visible) setPoints(seams, positions, skin.seams);
      soon();
      return range;
    }

    return {
      show,
      look(from) { direction = new THREE.Vector3(...from); fit(); },
      /* Frame points, (3 n), from a direction. */
      frame(points, from) { framed = points; this.look(from); },
    };
  }

  function start(bytes) {
    const read = reader(bytes), skins = {};
    for (const [name, packed] of Object.entries(scene.skins)) skins[name] = new Skin(read, packed);
    let view;
    try {
      view = viewer(skins);
    } catch (error) {
      say(`The view in space needs WebGL, which this browser does not offer: ${error.message}`);
      return;
    }
    const names = Object.keys(scene.series), current = {}, sliders = {};
    let series = scene.start.series, playing = null;
    const frameOf = (name) => scene.series[name][current[name]], unpacked = new Set();

    /* Unpack the shapes of a series when they are asked for: others need not wait for them. */
    function prepare() {
      if (!unpacked.has(series)) unpackSeries(read, scene.series[series]);
      unpacked.add(series);
    }

    /* Place the camera for a frame, and the body beside it. */
    function around(frame) {
      prepare();
      const { body } = skins[frame.skin];
      const points = [...placed(frame.positions), ...(body ? body.points : [])];
      view.frame(Float32Array.from(points), scene.from[series]);
    }

    function entries(parent, rows) {
      parent.replaceChildren(...rows.map((texts) => {
        const row = document.createElement(texts.length > 1 ? "div" : "span");
        if (texts.length === 1) row.textContent = texts[0];
        else row.append(...texts.map((text, k) => {
          const part = document.createElement(k ? "dd" : "dt");
          part.textContent = text;
          return part;
        }));
        return row;
      }));
    }

    function update() {
      prepare();
      const frame = frameOf(series), skin = skins[frame.skin];
      at("with-target").hidden = !skin.target;
      at("with-body").hidden = !skin.body && !skin.grounds.length;
      const distance = document.querySelector("input[value=distance]");
      distance.parentElement.hidden = !skin.target;
      if (!skin.target && distance.checked) document.querySelector("input[value=print]").checked = true;
      const mode = document.querySelector("input[name=colour]:checked").value;
      const range = view.show(frame, mode);
      at("caption").textContent = series === "iteration" ? `iteration ${frame.label}` : frame.label;
      at("bar").hidden = range === null;
      if (range) {
        const unit = mode === "distance" ? " mm" : "";
        at("bar-title").textContent = unit ? "distance from the target (mm)" : "largest principal stretch";
        at("bar-colours").style.background = `linear-gradient(to right, ${SCALE.join(",")})`;
        entries(at("bar-marks"), [0, 0.5, 1].map((part) =>
          [`${+(range[0] + part * (range[1] - range[0])).toPrecision(3)}${unit}`]));
      }
      entries(at("values"), frame.shown);
      at("note").textContent = frame.note;
      at("note").hidden = !frame.note;
      for (const name of names) {
        sliders[name].classList.toggle("now", name === series);
        sliders[name].querySelector("b").textContent = frameOf(name).label;
      }
      for (const chart of document.querySelectorAll("svg.chart")) {
        const line = chart.querySelector(".now"), data = chart.dataset;
        const part = (frame.x - data.low) / (data.high - data.low);
        const here = data.series === series && part >= 0 && part <= 1;
        const x = here ? +data.left + part * (data.right - data.left) : -9;
        line.setAttribute("x1", x);
        line.setAttribute("x2", x);
      }
    }

    function choose(name, index) {
      const other = scene.frame_of[name] !== scene.frame_of[series];
      series = name;
      if (other) around(scene.series[name].at(-1));
      current[name] = index;
      update();
    }

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
      const [label, input, button] = ["label", "input", "button"].map((part) => row.querySelector(part));
      label.textContent = WORDS[name];
      label.htmlFor = input.id = `slider-${name}`;
      label.addEventListener("click", () => { if (name !== series) choose(name, current[name]); });
      input.max = count - 1;
      input.value = current[name];
      input.hidden = count < 2;
      input.addEventListener("input", () => { stop(); choose(name, +input.value); });
      input.addEventListener("pointerdown", () => { if (name !== series) choose(name, +input.value); });
      button.setAttribute("aria-label", `play over ${WORDS[name]}`);
      if (count < 2) button.textContent = "show";
      button.addEventListener("click", () => {
        const again = playing !== null && series === name;
        stop();
        if (count < 2) choose(name, 0);
        if (again || count < 2) return;
        button.textContent = "❚❚";
        playing = setInterval(() => {
          input.value = (current[name] + 1) % count;
          choose(name, +input.value);
        }, Math.max(60, Math.min(400, 6000 / count)));
      });
      sliders[name] = row;
      at("sliders").append(row);
    }
    for (const input of document.querySelectorAll("#colours input, #switches input"))
      input.addEventListener("change", update);
    for (const button of document.querySelectorAll("#views button"))
      button.addEventListener("click", () => {
        const { from } = button.dataset;
        if (from === "best") around(frameOf(series));
        else view.look(from.split(",").map(Number));
      });
    around(frameOf(series));
    update();
    requestAnimationFrame(() => requestAnimationFrame(() => {
      document.documentElement.dataset.state = "ready";
    }));
  }

  if (!scene.start) {
    document.documentElement.dataset.state = "ready";
  } else if (typeof DecompressionStream === "undefined") {
    say("This browser is too old for the view in space; it needs Chromium 80, Firefox 113 or Safari 16.4.");
  } else {
    unpack(at("data").textContent).then(start).catch((error) => {
      say(`The view in space could not be drawn: ${error.message}`);
      throw error;
    });
  }
})();
