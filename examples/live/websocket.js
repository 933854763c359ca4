// Frames of depth_pose over WebSocket: each is one JSON text. Plain functions, in a browser or in node.

// Calls onFrame with each frame, and connects again a second after the connection is lost.
function listen(url, { onFrame, onState }) {
  const socket = new WebSocket(url);
  socket.onopen = () => onState(`connected to ${url}`);
  socket.onmessage = (event) => onFrame(JSON.parse(event.data));
  socket.onclose = () => {
    onState(`nothing at ${url}; trying again`);
    setTimeout(() => listen(url, { onFrame, onState }), 1000);
  };
  return socket;
}

// The frame as skeletons.js draws it: as depth_pose_msgs/SkeletonArray.
function asMessage(frame) {
  const skeletons = frame.people.map((person) => ({
    body_id: person.body_id,
    joints: Object.entries(person.joints).map(([name, joint]) => {
      const [x, y, z] = joint.position;
      return { name, position: { x, y, z }, confidence: joint.confidence };
    }),
  }));
  return { skeletons };
}

// One person in words: name, distance and speed.
function describe(person) {
  const speed = person.velocity ? `, ${Math.hypot(...person.velocity).toFixed(1)} m/s` : "";
  return `${person.body_id} at ${person.centre[2].toFixed(1)} m${speed}`;
}

if (typeof module !== "undefined") module.exports = { asMessage, describe, listen };
