"""How well the words of a page are told from what is behind them (WCAG 2's contrast ratio)."""

from playwright.sync_api import Page

ENOUGH = 4.5  # of WCAG 2, level AA, for words of any size
# Words that are seen, with less than ENOUGH: the colour of each over what its ancestors paint, with
# their opacities. What a canvas or a picture shows has no words here.
FAINT = """enough => {
  const parts = colour => {
    const n = (colour.match(/[0-9.]+/g) || [0, 0, 0, 0]).map(Number);
    return [...n.slice(0, 3), n[3] ?? 1]; };
  const over = (a, b) => [0, 1, 2].map(i => a[3] * a[i] + (1 - a[3]) * b[i]);
  const light = colour => {
    const v = colour.map(c => c / 255)
      .map(c => c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
    return 0.2126 * v[0] + 0.7152 * v[1] + 0.0722 * v[2]; };
  const faint = [], words = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  let looked = 0;
  for (let node; (node = words.nextNode()); ) {
    const text = node.textContent.trim(), one = node.parentElement, range = new Range();
    range.selectNodeContents(node);
    const box = range.getBoundingClientRect();
    if (!text || box.width < 2 || box.height < 2 || one.closest("script, style")
      || !one.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
    let ground = [255, 255, 255], opacity = 1;
    const chain = [];
    for (let e = one; e; e = e.parentElement) chain.unshift(getComputedStyle(e));
    for (const style of chain) {
      ground = over(parts(style.backgroundColor), ground);
      opacity *= style.opacity; }
    const ink = parts(one.closest("svg") ? chain.at(-1).fill : chain.at(-1).color);
    ink[3] *= opacity;
    const [dark, bright] = [light(over(ink, ground)), light(ground)].sort((a, b) => a - b);
    const ratio = (bright + 0.05) / (dark + 0.05);
    if (ratio < enough) faint.push(`${ratio.toFixed(2)}: ${text.slice(0, 40)}`);
    looked += 1; }
  return [looked, [...new Set(faint)]]; }"""


def faint_words(page: Page) -> list[str]:
    """Ratio and words of every text in view whose contrast is less than ENOUGH."""
    looked, faint = page.evaluate(FAINT, ENOUGH)
    assert looked > 0
    return faint
