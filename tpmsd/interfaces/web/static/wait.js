// Begins the diagnosis, waits for it, then shows it.
import { byId } from "./common.js";

async function look() {
  try {
    const told = await (await fetch("api/diagnosis", { method: "POST" })).json(); // begins it once
    if (told.state === "done") return location.reload();
    byId("share").value = told.share;
    byId("share").textContent = `${Math.round(100 * told.share)} %`;
    if (told.state === "failed") {
      byId("said").textContent = told.reason;
      return byId("share").remove();
    }
  } catch {
    byId("said").textContent = "The server does not answer.";
  }
  setTimeout(look, 1000);
}
look();
