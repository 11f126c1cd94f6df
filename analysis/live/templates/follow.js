// The newest state of the run, asked for again and again. Where nobody answers, the page says so and goes on asking.
const PERIOD_MS = Number(document.body.dataset.period) * 1000, PATIENCE_MS = 10000;
const hold = document.getElementById("hold");

function say(texts) {
  for (const place of document.querySelectorAll("[data-said]")) {
    const text = texts[place.dataset.said];
    if (text !== undefined && place.textContent !== text) place.textContent = text;
  }
}

async function follow() {
  try {
    const answer = await fetch("state.json", { cache: "no-store", signal: AbortSignal.timeout(PATIENCE_MS) });
    if (!answer.ok) throw new Error(answer.statusText);
    const state = await answer.json();
    say({ ...state.texts, silence: "" });
    if (!hold.checked) for (const plot of plots) plot.renew(state.explorer);
  } catch {
    say({ silence: "mccd watch does not answer: it has ended, or this machine is busy. This is the last that it told." });
  }
  setTimeout(follow, PERIOD_MS);
}
hold.closest("label").hidden = false;
setTimeout(follow, PERIOD_MS);
