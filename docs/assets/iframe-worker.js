// A Worker for pages that are opened from a folder, where browsers refuse workers: the script runs in a hidden frame.
// The search of the theme posts and receives plain data, and loads its languages with importScripts; no more is done here.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.waiting = [];
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.appendChild(frame);
      const inside = (this.inside = frame.contentWindow);
      inside.document.open();
      inside.document.write("<!doctype html><html><head></head><body></body></html>");
      inside.document.close();
      const load = (address) =>
        new Promise((done, failed) => {
          const script = inside.document.createElement("script");
          script.onload = done;
          script.onerror = failed;
          script.src = address;
          inside.document.head.appendChild(script);
        });
      // Scripts load one after the other; callers may wait for the promise.
      inside.importScripts = (...addresses) =>
        addresses.reduce((before, address) => before.then(() => load(new URL(address, url).href)), Promise.resolve());
      inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      this.frame = frame;
      load(url).then(() => {
        this.ready = true;
        for (const data of this.waiting) this.deliver(data);
      });
    }
    addEventListener(kind, listener, options) {
      super.addEventListener(kind, listener, options);
    }
    set onmessage(listener) {
      this.addEventListener("message", listener);
    }
    deliver(data) {
      this.inside.dispatchEvent(new this.inside.MessageEvent("message", { data }));
    }
    postMessage(data) {
      if (this.ready) this.deliver(data);
      else this.waiting.push(data);
    }
    terminate() {
      this.frame.remove();
    }
  };
}
