// Web workers for pages that are opened from the disk, where browsers refuse to start any: the script runs in a hidden
// frame of the page. It does what the theme's search needs, messages both ways. The theme's offline plugin leaves out
// the script that it would otherwise load from another host where it finds one of this name.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(address) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      this.inside = new Promise((resolve, reject) => {
        frame.addEventListener("load", () => {
          const inside = frame.contentWindow;
          inside.postMessage = data => this.dispatchEvent(new MessageEvent("message", {data}));
          const script = inside.document.createElement("script");
          script.src = new URL(address, location);
          script.onload = () => resolve(inside);
          script.onerror = () => reject(new Error(`${script.src} cannot be read`));
          inside.document.head.append(script);
        }, {once: true});
      });
      document.body.append(frame);
    }

    postMessage(data) {
      this.inside.then(inside => inside.dispatchEvent(new inside.MessageEvent("message", {data})));
    }
  };
}
