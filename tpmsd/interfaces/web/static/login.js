// Sends the token once; the cookie that comes back carries it from then on.
document.getElementById("login").addEventListener("submit", async (event) => {
  event.preventDefault();
  const answer = await fetch("login", { method: "POST", body: document.getElementById("token").value });
  if (answer.ok) location.assign("./");
  else document.getElementById("answer").textContent = "This is not the token.";
});
