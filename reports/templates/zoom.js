// One window on all pictures of a group: scale and offset in units of a picture's width and height.
function zoomed(group) {
  const pane = { scale: 1, x: 0, y: 0 };
  function place() {
    pane.x = Math.min(0, Math.max(1 - pane.scale, pane.x));
    pane.y = Math.min(0, Math.max(1 - pane.scale, pane.y));
    for (const view of group.querySelectorAll(".view")) {
      view.classList.toggle("close", pane.scale > 1.5);
      for (const image of view.querySelectorAll("img")) image.style.transform = `translate(${100 * pane.x}%, ${100 * pane.y}%) scale(${pane.scale})`;
      for (const mark of view.querySelectorAll("b")) {
        mark.style.left = `${100 * (pane.x + pane.scale * mark.dataset.u)}%`;
        mark.style.top = `${100 * (pane.y + pane.scale * mark.dataset.v)}%`;
      }
    }
  }
  group.addEventListener("wheel", (event) => {
    const view = event.target.closest(".view");
    if (!view) return;
    event.preventDefault();
    const box = view.getBoundingClientRect();
    const u = (event.clientX - box.left) / box.width, v = (event.clientY - box.top) / box.height;
    const scale = Math.min(64, Math.max(1, pane.scale * Math.exp(-event.deltaY / 400)));
    pane.x = u - ((u - pane.x) * scale) / pane.scale;
    pane.y = v - ((v - pane.y) * scale) / pane.scale;
    pane.scale = scale;
    place();
  }, { passive: false });
  group.addEventListener("pointerdown", (event) => {
    const view = event.target.closest(".view");
    if (!view) return;
    view.setPointerCapture(event.pointerId);
    const box = view.getBoundingClientRect();
    const move = (next) => { pane.x += next.movementX / box.width; pane.y += next.movementY / box.height; place(); };
    view.addEventListener("pointermove", move);
    view.addEventListener("pointerup", () => view.removeEventListener("pointermove", move), { once: true });
    view.addEventListener("pointercancel", () => view.removeEventListener("pointermove", move), { once: true });
  });
  group.addEventListener("dblclick", () => { Object.assign(pane, { scale: 1, x: 0, y: 0 }); place(); });
  return (u, v) => {
    pane.scale = Math.max(pane.scale, 8);
    pane.x = 0.5 - u * pane.scale;
    pane.y = 0.5 - v * pane.scale;
    place();
  };
}
