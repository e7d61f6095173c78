// The controls of a live world in a notebook; live_widget.py runs the frames.

const INTERVAL = 40; // milliseconds between two frames at the earliest

// Once for each widget, also if several outputs show it.
function initialize({ model }) {
  let timer = 0;
  const request = () => {
    timer = 0;
    if (model.get("playing")) model.send({ run: 1 });
  };
  const schedule = () => {
    // The next frame is requested after the last one has arrived, so a slow kernel or a slow line
    // never has a queue of requests.
    if (model.get("playing") && !timer) timer = setTimeout(request, INTERVAL);
  };
  model.on("change:playing", schedule);
  model.on("msg:custom", schedule);
  return () => clearTimeout(timer);
}

function button(text, title, act) {
  const made = document.createElement("button");
  Object.assign(made, { type: "button", textContent: text, title, onclick: act });
  made.style.minWidth = "4.5em";
  return made;
}

function render({ model, el }) {
  const image = document.createElement("img");
  image.style.cssText = "max-width: 100%; max-height: 30em; display: block";
  const bar = document.createElement("div");
  bar.style.cssText = "display: flex; gap: .6em; align-items: center; padding: .3em 0";
  const status = document.createElement("output");
  status.style.fontVariantNumeric = "tabular-nums";
  const problem = document.createElement("pre");
  const step = button("Step", "Run one frame", () => model.send({ run: 1 }));
  const play = button("Play", "Run frames until you pause", () => {
    model.set("playing", !model.get("playing"));
    model.save_changes();
  });
  const show = () => {
    const picture = model.get("picture");
    image.hidden = !picture;
    if (picture) image.src = "data:image/svg+xml," + encodeURIComponent(picture);
    image.alt = status.textContent = model.get("status");
    problem.textContent = model.get("problem");
    problem.hidden = !problem.textContent;
    play.textContent = model.get("playing") ? "Pause" : "Play";
    step.disabled = model.get("ended") || model.get("playing");
    play.disabled = model.get("ended");
  };
  bar.append(step, play, status);
  el.append(image, bar, problem);
  const names = ["picture", "status", "problem", "playing", "ended"];
  names.forEach((name) => model.on(`change:${name}`, show));
  show();
  return () => names.forEach((name) => model.off(`change:${name}`, show));
}

export default { initialize, render };
