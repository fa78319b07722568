// Figures and plotly are packed with gzip; each figure is drawn when it is first seen.
const unpack = async (text) => {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
};

const settings = { displayModeBar: false, responsive: true, doubleClick: "autosize" };

const drawSeen = async () => {
  for (const place of document.querySelectorAll(".figure:not(.drawn)")) {
    if (place.offsetParent === null) continue;
    place.classList.add("drawn");
    const figure = JSON.parse(await unpack(place.firstElementChild.textContent));
    place.replaceChildren();
    await Plotly.newPlot(place, figure.data, figure.layout, settings);
  }
};

const choose = (name, value) => {
  for (const place of document.querySelectorAll(`[data-${name}]`)) place.hidden = place.dataset[name] !== value;
  drawSeen();
};

const start = async () => {
  const packed = document.getElementById("plotly");
  if (!packed) return;
  if (!("DecompressionStream" in window)) {
    for (const place of document.querySelectorAll(".figure")) {
      place.replaceChildren("This browser is too old to draw the figures: one of 2023 or later is needed.");
    }
    return;
  }
  const script = document.createElement("script");
  script.textContent = await unpack(packed.textContent);
  packed.remove();
  document.head.append(script);
  document.addEventListener("toggle", drawSeen, true);
  document.addEventListener("change", (event) => choose(event.target.name, event.target.value));
  await drawSeen();
};

start();
