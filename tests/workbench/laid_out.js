// What is wrong with the layout of the page, one sentence each: texts that overlap, things that stick out, axes without a unit.
() => {
  const said = []
  const wide = document.documentElement.scrollWidth - window.innerWidth
  if (wide > 0) said.push(`the page is ${wide} px too wide`)
  // What of a box is seen in what scrolls sideways, such as a wide table on a narrow page.
  const seen = (box, element) => {
    const outer = element.closest("table.figures")
    if (!outer || getComputedStyle(outer).overflowX !== "auto") return box
    const frame = outer.getBoundingClientRect()
    const left = Math.max(box.left, frame.left), right = Math.min(box.right, frame.right)
    return new DOMRect(left, box.top, Math.max(right - left, 0), box.height)
  }
  const boxes = []
  const walker = document.createTreeWalker(document.querySelector("main"), NodeFilter.SHOW_TEXT)
  while (walker.nextNode()) {
    const node = walker.currentNode, parent = node.parentElement
    if (!node.textContent.trim() || !parent.checkVisibility({opacityProperty: true, visibilityProperty: true})) continue
    if (parent.closest("i, .q-icon, .q-field__label, .q-slider, title, style, .hoverlayer, .q-uploader")) continue
    const range = document.createRange()
    range.selectNodeContents(node)
    for (const box of [...range.getClientRects()].map(one => seen(one, parent)))
      if (box.width > 1 && box.height > 1) boxes.push({box, text: node.textContent.trim().slice(0, 40), parent})
  }
  const over = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 3 &&
    Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 4
  for (let i = 0; i < boxes.length; i++)
    for (let k = i + 1; k < boxes.length; k++)
      if (boxes[i].parent !== boxes[k].parent && over(boxes[i].box, boxes[k].box))
        said.push(`"${boxes[i].text}" lies over "${boxes[k].text}"`)
  for (const {box, text, parent} of boxes) {
    const card = parent.closest(".card")?.getBoundingClientRect()
    if (card && (box.right > card.right + 1 || box.left < card.left - 1)) said.push(`"${text}" sticks out of its card`)
  }
  for (const plot of document.querySelectorAll(".js-plotly-plot"))
    if (plot.checkVisibility() && plot.clientWidth < 200) said.push(`a chart is ${plot.clientWidth} px wide`)
  for (const plot of document.querySelectorAll(".js-plotly-plot"))
    for (const title of plot.querySelectorAll(".xtitle, .ytitle"))
      // a column of one's own has no other name than its own
      if (!/\(.+\)$|^[a-z0-9]+_[a-z0-9_]+$/.test(title.textContent)) said.push(`the axis "${title.textContent}" has no unit`)
  return said
}
