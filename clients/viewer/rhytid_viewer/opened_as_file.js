// Not a module: browsers load no modules from file:, and this says so.
if (location.protocol === "file:") {
  const text = document.getElementById("message-text");
  const detail = document.getElementById("message-detail");
  const message = document.getElementById("message");
  if (text && detail && message) {
    text.textContent = "This page has to come from a web server. Browsers load no parts of a page from a folder.";
    detail.textContent =
      "In the folder of this file run: python3 -m http.server 8000 --bind 127.0.0.1, then open http://127.0.0.1:8000/";
    message.hidden = false;
  }
}
