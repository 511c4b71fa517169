// The bar above viser's page: STOP, Esc, whether the program lives, light or dark.
// It asks the program by itself, so it works whatever viser's own connection and widgets do.
(() => {
  "use strict";
  const EVERY_MS = 1000, SOON_MS = 150, PATIENCE_MS = 3000, LONG_MS = 5000,
    GIVEN_UP_MS = 30000, CONNECT_MS = 10000, LAID_OUT_MS = 500;
  const NO_VOLTS = ["at rest", "stopped"];
  const STATES = {
    starting: "Starting", balancing: "Balancing", running: "Run is on", "run starting": "Run is starting",
    pause: "Pause between runs", stopping: "Stopping: the plate is levelled",
    "at rest": "Stopped, motors at 0 V", stopped: "Stopped, motors at 0 V",
  };
  const SWITCH = "The motors may still have power: use the switch.";
  const inView = /\/view\/*$/.test(location.pathname);
  const here = location.pathname.replace(/(\/view)?\/*$/, "");

  // --- light or dark: this page's own, by the system's preference until it is chosen ---
  const root = document.documentElement, key = "rig-looks", scheme = "data-mantine-color-scheme";
  let dark = (localStorage.getItem(key)
    || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
  const dress = () => {
    const looks = root.dataset.looks = dark ? "dark" : "light";
    // viser makes its page light as it begins; its style goes by this attribute alone.
    if (root.getAttribute(scheme) !== looks) root.setAttribute(scheme, looks);
  };
  if (location.search) history.replaceState(null, "", location.pathname);  // viser's own ?darkMode
  new MutationObserver(dress).observe(root, { attributeFilter: [scheme] });
  dress();

  // --- the bar ---
  const make = (tag, id, text) => {
    const one = Object.assign(document.createElement(tag), { id, textContent: text });
    bar.append(one);
    return one;
  };
  const bar = document.createElement("div");
  bar.id = "rig-bar";
  const stop = make("button", "rig-stop", "■ STOP");
  stop.title = "Stops whatever moves, for everybody: also the key Esc. This is not the emergency "
    + "stop, which is the switch that cuts the motors' power.";
  const words = make("span", "rig-state", "Connecting ...");
  words.setAttribute("role", "status");
  const again = make("button", "rig-again", "Reload");
  const view = make("button", "rig-view", inView ? "All controls" : "Big view ↗");
  view.classList.toggle("in-view", inView);
  view.title = inView ? "The whole dashboard, in this tab."
    : "Plate, numbers and curves for a projector or a phone, in a tab of its own.";
  view.onclick = () => inView ? location.assign(`${here}/`) : open(`${here}/view`, "_blank", "noopener");
  const looks = make("button", "rig-looks", dark ? "Light" : "Dark");
  again.hidden = true;
  again.onclick = () => location.reload();
  looks.onclick = () => {
    dark = !dark;
    localStorage.setItem(key, dark ? "dark" : "light");
    looks.textContent = dark ? "Light" : "Dark";
    dress();
  };
  const show = () => document.body ? document.body.append(bar) : setTimeout(show, 10);
  show();

  // --- what the program says ---
  let now = "", gone = false, lostAt = null, stoppingAt = null, began = "", timer = 0, asked = 0,
    halts = 0, unheard = false,  // unheard: STOP, which is asked again
    anew = false,  // started anew, and this page cannot return by itself
    secret = "",  // in this page's memory alone: whoever serves a page here later never sees it
    heardAt = Date.now(), shownAt = Date.now();
  const ask = async (what) => {
    const patience = AbortSignal.timeout(PATIENCE_MS);
    const answer = await fetch(`${here}/${what}`, { cache: "no-store", signal: patience });
    if (answer.status === 403 && secret) await comeBack(patience);
    if (!answer.ok) throw new Error(answer.statusText);
    return answer.json();
  };
  // The program was started anew, or it is another one: this page proves that it was open before,
  // for its own address alone.
  const comeBack = async (signal) => {
    if (!window.crypto?.subtle) {  // over the network without TLS
      anew = true;
      return;
    }
    const coded = (text) => new TextEncoder().encode(text);
    const how = { name: "HMAC", hash: "SHA-256" };
    const { number } = await (await fetch(`${here}/question`, { cache: "no-store", signal })).json();
    const key = await crypto.subtle.importKey("raw", coded(secret), how, false, ["sign"]);
    const proof = await crypto.subtle.sign("HMAC", key, coded(`${number} ${location.host}`));
    const digits = [...new Uint8Array(proof)].map((byte) => byte.toString(16).padStart(2, "0"));
    const query = new URLSearchParams({ number, proof: digits.join("") });
    await fetch(`${here}/return?${query}`, { cache: "no-store", signal });
  };
  const write = (text, kind = "") => {
    if (words.textContent !== text) words.textContent = text;
    bar.className = kind;
  };
  const told = (state) => {
    const rests = state.state === "stopped" || state.state === "at rest";
    if (rests) stoppingAt = null, unheard = false;
    if (unheard) return;  // its warning stays
    const away = lostAt === null ? 0 : Date.now() - lostAt;
    // Another program, or a connection that viser has lost, too; one that was slow goes on.
    if (began && began !== state.began || away > (gone ? PATIENCE_MS : GIVEN_UP_MS))
      return location.reload();
    began = state.began;
    secret = state.secret;
    anew = false;
    now = state.state;
    lostAt = null;
    heardAt = Date.now();
    gone = false;
    again.hidden = true;
    root.classList.remove("rig-lost");
    if (stoppingAt === null) write(STATES[state.state] || state.state, state.state);
    else if (Date.now() - stoppingAt > LONG_MS) write("STOP takes long: use the switch.", "lost");
  };
  const lost = (error, askedAt) => {
    // The browser holds up a page that nobody sees: what it asked then was not kept waiting by us.
    if (document.hidden || askedAt < shownAt) return;
    const silent = Date.now() - heardAt;
    if (!began && silent < CONNECT_MS) return;  // a page that was just opened has lost nothing
    lostAt ??= Date.now();
    gone ||= error.name !== "TimeoutError";
    const seconds = Math.max(1, Math.round(silent / 1000));
    root.classList.add("rig-lost");
    again.hidden = false;
    const then = anew ? "Started anew: open the link that it printed." : "Trying again ...";
    if (!unheard) write(`Connection lost ${seconds} s ago. ${SWITCH} ${then}`, "lost");
  };
  const poll = async () => {
    clearTimeout(timer);
    const mine = ++asked, askedAt = Date.now();
    try {
      const state = await ask("alive");
      if (mine === asked) told(state);
    } catch (error) {
      if (mine === asked) lost(error, askedAt);
    }
    if (mine === asked) timer = setTimeout(poll, stoppingAt === null ? EVERY_MS : SOON_MS);
  };
  const halt = async () => {
    const mine = ++halts;
    stoppingAt = Date.now();
    if (!unheard) write("Stopping ...", "stopping");
    while (mine === halts && stoppingAt !== null) {
      try {
        const answer = ask("stop");
        poll();  // no answer counts that was asked for before
        await answer;
        unheard = false;
        if (stoppingAt !== null) write("Stopping ...", "stopping");
        break;
      } catch {
        if (mine !== halts) return;  // pressed again meanwhile: that press asks on
        if (stoppingAt === null) break;
        unheard = true;
        root.classList.add("rig-lost");
        write(`STOP was not answered. ${SWITCH}`, "lost");
        await new Promise((done) => setTimeout(done, SOON_MS));
      }
    }
    poll();
  };

  // At the press, not at the release; a key on the button clicks it.
  stop.addEventListener("pointerdown", (event) => { if (event.button === 0) halt(); });
  stop.addEventListener("click", (event) => { if (event.detail === 0) halt(); });
  // Esc stops whatever has the focus, a list that it closes, too: who is afraid presses it once.
  // Only an enlarged picture it closes alone, and only while the program says that the motors are at 0 V.
  const enlarged = () => document.querySelector(".mantine-Modal-body img");
  const noVolts = () => lostAt === null && stoppingAt === null && NO_VOLTS.includes(now);
  addEventListener("keydown", (event) => {
    if (event.key === "Escape" && !event.repeat && !(enlarged() && noVolts())) halt();
  }, true);
  // viser enlarges a picture by an icon alone, which it shows while a mouse is over the picture.
  addEventListener("click", (event) => {
    const picture = event.target.closest?.('p + div > img[src^="blob:"]');
    if (!picture) return;
    picture.dispatchEvent(new MouseEvent("mouseover", { bubbles: true }));  // a finger's, too
    setTimeout(() => picture.parentElement.querySelector("button")?.click(), SOON_MS);
  });
  // viser builds its panels anew where a window becomes as narrow as a phone's, or wide again: the
  // tabs that were chosen stay so.
  const chosen = new Map(), laid = new WeakSet();  // chosen: by the names in a row of tabs
  const openTab = (tab) => {
    tab.click();  // a phone's; those of a wide page take keys
    tab.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
  };
  addEventListener("click", (event) => {
    const tab = event.target.closest?.('[role="tab"]'), row = tab?.closest('[role="tablist"]');
    if (row && event.isTrusted) chosen.set(row.textContent, tab.textContent);
  }, true);
  setInterval(() => {
    for (const row of document.querySelectorAll('[role="tablist"]')) {
      if (laid.has(row) || !chosen.has(row.textContent)) continue;
      laid.add(row);
      for (const tab of row.querySelectorAll('[aria-selected="false"]'))
        if (chosen.get(row.textContent) === tab.textContent) openTab(tab);
    }
  }, LAID_OUT_MS);
  // Who listens to the page hears of a field the words beside it: viser ties only some to theirs.
  // Of a button that is an icon alone they hear what viser tells a mouse that rests on it. Names of
  // viser's own stay; ours go along with words and icons that change.
  const ICONS = { "list-search": "Commands (Ctrl+K)", adjustments: "Configuration & diagnostics",
    "arrow-back": "Return to GUI" };
  const named = new WeakMap();
  const call = (one, name) => {
    const now = one.getAttribute("aria-label") ?? "";
    if (now === name || now !== (named.get(one) ?? "")) return;
    named.set(one, name);
    if (name) one.setAttribute("aria-label", name);
    else one.removeAttribute("aria-label");
  };
  setInterval(() => {
    for (const label of document.querySelectorAll("label[for]"))
      for (const field of label.control ? []
        : label.closest(".mantine-Flex-root")?.querySelectorAll("input, [role=slider]") ?? []) {
        call(field, label.textContent);
        // It has a unit: a number, none below 0, as iOS then has no minus.
        if (/\]$/.test(label.textContent)) field.inputMode = "decimal";
      }
    for (const one of document.querySelectorAll("button:not([aria-hidden])")) {
      const icon = /tabler-icon-([\w-]+)/.exec(one.innerHTML)?.[1]
        ?? (one.matches(".mantine-CloseButton-root") ? "close" : "");
      call(one, one.textContent.trim() ? "" : ICONS[icon] ?? icon.replaceAll("-", " "));
    }
  }, LAID_OUT_MS);
  // A button whose words end in "tab Replay" opens it.
  addEventListener("click", (event) => {
    const name = /, tab (\w+)$/.exec(event.target.closest?.("button")?.textContent ?? "")?.[1];
    for (const tab of name ? document.querySelectorAll('[role="tab"]') : [])
      if (tab.textContent === name) {
        chosen.set(tab.closest('[role="tablist"]').textContent, name);
        openTab(tab);
      }
  }, true);
  // An arrow is a command's: viser's 3-D view, which listens above the commands, would turn, too.
  root.addEventListener("keydown", (event) => {
    if (event.key.startsWith("Arrow")) event.stopPropagation();
  });
  // A tab or a button that was clicked keeps no key: arrows would turn the tabs, Space press again.
  addEventListener("click", (event) => {
    if (event.detail > 0) event.target.closest?.("button, [role=tab]")?.blur();
  });
  // Two fingers, or a phone's keyboard, move what is seen over the page: the bar goes along.
  const seen = window.visualViewport;
  const goAlong = () => bar.style.translate = `${seen.offsetLeft}px ${seen.offsetTop}px`;
  for (const what of ["scroll", "resize"]) seen?.addEventListener(what, goAlong);
  // On a phone the table stands above viser's sheet, which folds.
  const sheet = () => document.querySelector('.mantine-Paper-root[style*="position: fixed"]');
  setInterval(() => root.style.setProperty(
    "--rig-sheet", `${sheet()?.offsetHeight || 0}px`), 500);
  addEventListener("visibilitychange", () => {
    if (document.hidden) return;
    shownAt = Date.now();
    poll();
  });
  poll();
})();
