// The machine moving: `frames` has the numbers of all frames, `colors` those of the page.

const PER_FRAME = 60 // milliseconds
const SVG = "http://www.w3.org/2000/svg"

function shape(parent, kind, attributes) {
  const one = document.createElementNS(SVG, kind)
  for (const [name, value] of Object.entries(attributes)) one.setAttribute(name, value)
  parent.appendChild(one)
  return one
}

// Lines one after the other; null between them.
function path(x, y) {
  let told = "", pen = "M"
  for (let i = 0; i < x.length; i++) {
    if (x[i] === null) { pen = "M"; continue }
    told += pen + x[i] + " " + y[i]
    pen = "L"
  }
  return told
}

// The parts of a machine, and what puts them into a frame. Heights grow downwards in the browser.
function drawing(svg, film, colors) {
  const [left, right, bottom, top] = film.extent
  svg.setAttribute("viewBox", `${left - 0.1} ${-top - 0.1} ${right - left + 0.2} ${top - bottom + 0.2}`)
  svg.style.maxHeight = top - bottom > right - left ? "360px" : "220px"
  const hatch = shape(shape(svg, "defs", {}), "pattern", {id: "hatch", width: 0.08, height: 0.08,
    patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)"})
  shape(hatch, "line", {x1: 0, y1: 0, x2: 0, y2: 0.08, stroke: colors.faint, "stroke-width": 0.03})
  const line = {fill: "none", stroke: colors.ink, "stroke-width": 0.02, "stroke-linejoin": "round"}
  const shapeOf = (look) => {
    const fill = look === "hatch" ? "url(#hatch)" : look === "ink" ? colors.ink : colors.page
    const edge = look === "cavity" ? colors.faint : typeof look === "number" ? colors.masses[look] : "none"
    return shape(svg, "rect", {fill, stroke: edge, "stroke-width": look === "cavity" ? 0.02 : 0.04})
  }
  const isBox = (look) => typeof look === "number" || look === "cavity"
  const parts = film.looks.map((look) => isBox(look) ? null : shapeOf(look))
  const lines = shape(svg, "path", line)
  film.looks.forEach((look, i) => { if (isBox(look)) parts[i] = shapeOf(look) })
  const over = shape(svg, "path", {...line, "stroke-width": 0.03})
  const names = film.names[0].map((_, i) => {
    const name = shape(svg, "text", {"text-anchor": "middle", "font-size": 0.28, fill: colors.ink})
    name.textContent = i
    return name
  })
  const down = (y) => y.map((a) => a === null ? null : -a)
  return (k) => {
    lines.setAttribute("d", path(film.lines[k][0], down(film.lines[k][1])))
    over.setAttribute("d", path(film.over[k][0], down(film.over[k][1])))
    film.parts[k].forEach(([x, y, width, height], i) => {
      const place = {x, y: -y - height, width, height}
      for (const [name, value] of Object.entries(place)) parts[i].setAttribute(name, value)
      const mass = film.looks[i]
      if (typeof mass === "number") parts[i].setAttribute("fill", film.held[k][mass] ? colors.held : colors.page)
    })
    film.names[k].forEach(([x, y], i) => {
      names[i].setAttribute("x", x)
      names[i].setAttribute("y", 0.09 - y)
    })
  }
}

export function render({model, el}) {
  const svg = document.createElementNS(SVG, "svg")
  svg.setAttribute("class", "film")
  svg.style.cssText = "display: block; width: 100%"
  const bar = document.createElement("div")
  bar.style.cssText = "display: flex; gap: 8px; align-items: center"
  const button = document.createElement("button"), slider = document.createElement("input")
  button.style.cssText = `width: 5em; color: ${model.colors.ink}; background: none; border: 1px solid ${model.colors.faint}`
  slider.type = "range"
  slider.style.flex = "1"
  bar.append(button, slider)
  el.style.width = "100%"
  el.append(svg, bar)
  let show = () => {}, count = 0, timer = null

  const to = (k) => { slider.value = k; show(k) }
  const stop = () => { clearInterval(timer); timer = null; button.textContent = "play" }
  const play = () => {
    stop()
    button.textContent = "pause"
    timer = setInterval(() => count && to((Number(slider.value) + 1) % count), PER_FRAME)
  }
  const renew = () => {
    svg.replaceChildren()
    const film = model.frames
    count = film.parts ? film.parts.length : 0
    show = count ? drawing(svg, film, model.colors) : () => {}
    slider.max = Math.max(0, count - 1)
    to(0)
  }
  button.onclick = () => timer ? stop() : play()
  slider.oninput = () => { stop(); show(Number(slider.value)) }
  model.on("frames", renew)
  model.on("remove", stop)
  renew()
  play()
}
