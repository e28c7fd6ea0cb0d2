// Tables of wrong pixels; each row leads to its pixel. Text is set as text nodes, and never read as markup.
const hogels = JSON.parse(document.getElementById("data").textContent);

function shown(value) {
  if (value === null) return "-";
  return typeof value === "number" && !Number.isInteger(value) ? String(Number(value.toPrecision(7))) : String(value);
}

document.querySelectorAll(".hogel").forEach((section, number) => {
  const { size, columns, pixels } = hogels[number], go = zoomed(section.querySelector(".panels"));
  const table = section.querySelector("table");
  if (!table) return;
  const line = (texts, tag) => {
    const row = document.createElement("tr");
    for (const text of texts) row.append(Object.assign(document.createElement(tag), { textContent: text }));
    return row;
  };
  const head = document.createElement("thead"), body = document.createElement("tbody");
  head.append(line(columns, "th"));
  for (const values of pixels) {
    const row = line(values.map(shown), "td");
    row.addEventListener("click", () => {
      body.querySelector("[aria-selected]")?.removeAttribute("aria-selected");
      row.setAttribute("aria-selected", "true");
      const u = (values[0] + 0.5) / size[0], v = (values[1] + 0.5) / size[1];
      for (const view of section.querySelectorAll(".view")) {
        const mark = view.querySelector("b") || view.appendChild(document.createElement("b"));
        Object.assign(mark.dataset, { u, v });
      }
      go(u, v);
    });
    body.append(row);
  }
  table.append(head, body);
});
