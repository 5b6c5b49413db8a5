"use strict";
// Curves to zoom into and to read: in place of every picture that has its curves beside it.
(() => {
  const NS = "http://www.w3.org/2000/svg";
  const LEFT = 62, RIGHT = 10, TOP = 8, BOTTOM = 24, LABEL = 16;

  const node = (name, attributes = {}, parent = null, text = "") => {
    const made = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text) made.textContent = text;
    if (parent) parent.append(made);
    return made;
  };
  const short = value => value === null ? "-" : String(Number(value.toPrecision(4)));
  const shown = (value, log) => short(log && value !== null ? 10 ** value : value);

  function ticks(low, high, count) {
    const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].find(m => m * power >= raw) * power, values = [];
    for (let i = Math.ceil(low / step); i * step <= high * (1 + 1e-12) + 1e-300; i++)
      values.push(Number((i * step).toPrecision(10)));
    return values;
  }

  function nearest(x, value) { // x ascends
    let low = 0, high = x.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (x[middle] < value) low = middle; else high = middle;
    }
    return value - x[low] < x[high] - value ? low : high;
  }

  function draw(figure) {
    const panels = JSON.parse(figure.querySelector("script").textContent);
    const box = document.createElement("div");
    box.className = "plots";
    const readout = document.createElement("p");
    const help = "Drag to zoom; double click to see all again; point to read.";
    readout.className = "note readout";
    readout.textContent = help;
    const columns = new Map();
    for (const panel of panels) {
      if (!columns.has(panel.column)) columns.set(panel.column, []);
      columns.get(panel.column).push(panel);
    }
    for (const group of columns.values()) {
      const x = group.flatMap(p => p.series.flatMap(s => [s.x[0], s.x.at(-1)]));
      const all = [Math.min(...x), Math.max(...x)];
      const view = {range: all, all, group, readout, help};
      for (const panel of group) addPanel(box, panel, view);
    }
    figure.querySelector(".scroll").replaceWith(box);
    box.after(readout);
    const redraw = () => {
      for (const panel of panels) panel.redraw();
    };
    redraw();
    new ResizeObserver(redraw).observe(box);
  }

  function addPanel(box, panel, view) {
    const frame = document.createElement("div");
    const heading = document.createElement("p");
    heading.className = "note";
    heading.append([panel.ylabel, panel.title].filter(Boolean).join("; "));
    for (const one of panel.series) if (one.color === "#000000") one.color = "var(--ink)";
    for (const one of panel.series) // gray areas, on dark paper, too
      if (one.kind === "band" && /^#(..)\1\1$/.test(one.color)) one.color = "var(--line)";
    for (const one of panel.series.filter(s => s.name)) {
      const key = document.createElement("span");
      key.className = "key";
      key.style.borderColor = one.color;
      if (one.dashed) key.style.borderLeftStyle = "dashed";
      key.textContent = one.name;
      heading.append(" ", key);
    }
    const svg = node("svg", {role: "img", "aria-label": panel.ylabel});
    frame.append(heading, svg);
    box.append(frame);
    let width, height, low, high;
    const px = x => LEFT + (x - view.range[0]) / (view.range[1] - view.range[0])
      * (width - LEFT - RIGHT);
    const py = y => TOP + (high - y) / (high - low) * (height - TOP - BOTTOM);
    const at = event => {
      const left = event.clientX - svg.getBoundingClientRect().left;
      const share = (left - LEFT) / (width - LEFT - RIGHT);
      return view.range[0] + Math.min(1, Math.max(0, share))
        * (view.range[1] - view.range[0]);
    };

    panel.redraw = () => {
      width = Math.max(200, frame.clientWidth);
      height = Math.min(240, Math.max(130, width * 0.3));
      const label = panel.xlabel ? LABEL : 0; // of time, below the lowest panel
      const total = height + label;
      svg.replaceChildren();
      svg.setAttribute("viewBox", `0 0 ${width} ${total}`);
      svg.setAttribute("height", total);
      const middle = {x: (LEFT + width - RIGHT) / 2, y: height + 8, "text-anchor": "middle"};
      if (label) node("text", middle, svg, panel.xlabel);
      low = Infinity;
      high = -Infinity;
      for (const {x, y, high: top, kind} of panel.series) {
        if (kind === "stem") low = Math.min(low, 0), high = Math.max(high, 0);
        x.forEach((t, i) => {
          if (t < view.range[0] || t > view.range[1] || y[i] === null) return;
          low = Math.min(low, y[i]);
          high = Math.max(high, y[i], top ? top[i] : y[i]);
        });
      }
      if (panel.limits) low = Math.max(low, panel.limits[0]), high = Math.min(high, panel.limits[1]);
      if (!(low <= high)) [low, high] = panel.limits || [0, 0]; // all is out of view
      const margin = 0.06 * (high - low) || Math.abs(high) || 1;
      low -= margin;
      high += margin;
      const whole = (values, log) => log && values.filter(Number.isInteger).length > 1
        ? values.filter(Number.isInteger) : values;
      const places = ticks(...view.range, Math.max(2, Math.min(8, width / 90)));
      for (const t of whole(places, panel.xlog)) {
        node("line", {x1: px(t), x2: px(t), y1: TOP, y2: height - BOTTOM, class: "grid"}, svg);
        node("text", {x: px(t), y: height - 8, "text-anchor": "middle"}, svg,
          shown(t, panel.xlog));
      }
      for (const y of whole(ticks(low, high, 6), panel.ylog)) {
        node("line", {x1: LEFT, x2: width - RIGHT, y1: py(y), y2: py(y), class: "grid"}, svg);
        node("text", {x: LEFT - 5, y: py(y) + 4, "text-anchor": "end"}, svg,
          shown(y, panel.ylog));
      }
      const inside = node("svg", {
        x: LEFT, y: TOP, width: width - LEFT - RIGHT, height: height - TOP - BOTTOM,
        viewBox: `${LEFT} ${TOP} ${width - LEFT - RIGHT} ${height - TOP - BOTTOM}`,
      }, svg);
      for (const one of panel.series) {
        const style = {stroke: one.color, "stroke-width": one.width || 1, fill: "none"};
        if (one.dashed) style["stroke-dasharray"] = "6 4";
        let path = "", dots = "", pen = false;
        if (one.kind === "band") {
          const edge = (y, i) => `${px(one.x[i]).toFixed(1)},${py(y).toFixed(1)}`;
          path = "M" + one.y.map(edge).join("L") + "L"
            + one.high.map(edge).reverse().join("L") + "Z";
          node("path", {d: path, fill: one.color, opacity: 0.6}, inside);
          continue;
        }
        one.x.forEach((t, i) => {
          if (one.y[i] === null) { pen = false; return; }
          const [a, b] = [px(t).toFixed(1), py(one.y[i]).toFixed(1)];
          if (one.kind === "stem") path += `M${a},${py(0).toFixed(1)}V${b}`;
          else path += !pen ? `M${a},${b}` : one.step ? `H${a}V${b}` : `L${a},${b}`;
          if (!pen && (one.y[i + 1] ?? null) === null && one.kind !== "stem")
            dots += `M${a},${b}h0`; // a sample alone, which no line would show
          pen = true;
        });
        const dot = {"stroke-width": Math.max(4, one.width), "stroke-linecap": "round"};
        if (dots) node("path", {d: dots, ...style, ...dot}, inside);
        if (path) node("path", {d: path, ...style}, inside);
      }
      panel.cursor = node("line", {y1: TOP, y2: height - BOTTOM, class: "cursor"}, svg);
      panel.chosen = node("rect", {y: TOP, height: height - TOP - BOTTOM, class: "chosen"}, svg);
    };

    let start = null;
    svg.addEventListener("pointerdown", event => {
      start = at(event);
      svg.setPointerCapture(event.pointerId);
    });
    svg.addEventListener("pointermove", event => {
      const t = at(event);
      for (const one of view.group) {
        one.cursor.setAttribute("x1", px(t));
        one.cursor.setAttribute("x2", px(t));
        one.cursor.classList.add("shown");
      }
      if (start !== null) {
        panel.chosen.setAttribute("x", Math.min(px(start), px(t)));
        panel.chosen.setAttribute("width", Math.abs(px(t) - px(start)));
      }
      const label = view.group.map(p => p.xlabel).find(Boolean) || "x";
      const lines = [`${label}: ${shown(t, panel.xlog)}`];
      for (const one of view.group)
        for (const {name, x, y, kind} of one.series)
          if (kind !== "band")
            lines.push(`${name || one.ylabel}: ${shown(y[nearest(x, t)], one.ylog)}`);
      view.readout.textContent = lines.join("; ");
    });
    svg.addEventListener("pointerup", event => {
      const [a, b] = [start, at(event)].sort((p, q) => p - q);
      start = null;
      if (a !== null && b - a > 0.01 * (view.range[1] - view.range[0])) view.range = [a, b];
      for (const one of view.group) one.redraw();
    });
    svg.addEventListener("pointerleave", () => {
      for (const one of view.group) one.cursor.classList.remove("shown");
      view.readout.textContent = view.help;
    });
    svg.addEventListener("dblclick", () => {
      view.range = view.all;
      for (const one of view.group) one.redraw();
    });
  }

  document.querySelectorAll("figure.curves").forEach(draw);
})();
