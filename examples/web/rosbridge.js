// A subscription over rosbridge's protocol, which is JSON in a WebSocket; no library is needed.

function subscribe(url, { topic, type, throttleMs = 0 }, { onMessage, onState }) {
  const socket = new WebSocket(url);
  socket.onopen = () => {
    socket.send(JSON.stringify({ op: "subscribe", topic, type, throttle_rate: throttleMs, queue_length: 1 }));
    onState(`connected to ${url}`);
  };
  socket.onmessage = (event) => {
    const told = JSON.parse(event.data);
    if (told.op === "publish" && told.topic === topic) onMessage(told.msg);
    if (told.op === "status" && told.level === "error") onState(`rosbridge: ${told.msg}`);
  };
  socket.onerror = () => onState(`no rosbridge at ${url}`);
  socket.onclose = (event) => event.wasClean && onState(`the connection to ${url} is closed`);
  return socket;
}

if (typeof module !== "undefined") module.exports = { subscribe };
