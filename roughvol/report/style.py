"""The style of the report page: light, dark and on paper; a figure that is the target of a link fills the window."""

CSS = """
:root { --ground: #fdfdfc; --ink: #1c2127; --faint: #667080; --line: #dcdfe4; --card: #f4f5f6; --link: #1f5fa8;
  --good: #1d7a46; --good-bg: #e2f3e8; --half: #8a5a00; --half-bg: #fbefd5; --bad: #b3261e; --bad-bg: #fbe4e2;
  --none: #5b6470; --none-bg: #e9ebee; }
@media (prefers-color-scheme: dark) { :root { --ground: #14171b; --ink: #e4e7ea; --faint: #9aa4b1; --line: #333a43;
  --card: #1d2228; --link: #86b7f2; --good: #7ddaa0; --good-bg: #173726; --half: #f0c267; --half-bg: #3d3013;
  --bad: #ff9d94; --bad-bg: #471f1c; --none: #b4bcc7; --none-bg: #2b3138; } img { filter: brightness(.93); } }
* { box-sizing: border-box; }
html { scroll-padding-top: 1rem; font-size: 16px; }
body { margin: 0; background: var(--ground); color: var(--ink); line-height: 1.5;
  font: 1rem/1.5 system-ui, "Segoe UI", "Helvetica Neue", Arial, "DejaVu Sans", sans-serif; }
main { max-width: 62rem; margin: 0 auto; padding: 2rem 1.25rem 4rem; }
h1 { font-size: 2.1rem; line-height: 1.2; margin: 0 0 .4rem; } h2 { margin: 3rem 0 .8rem; font-size: 1.5rem; }
h3 { margin: 0 0 .3rem; font-size: 1.12rem; } .lead { font-size: 1.15rem; color: var(--faint); margin: 0 0 1rem; }
a { color: var(--link); } nav { margin-top: 1rem; }
small { color: var(--faint); font-size: .8em; } td small { display: block; } td.v small { display: inline; }
table { border-collapse: collapse; width: 100%; margin: .8rem 0; font-size: .9rem; }
th, td { text-align: left; vertical-align: top; padding: .38rem .6rem; border-bottom: 1px solid var(--line); }
th { font-weight: 600; color: var(--faint); vertical-align: bottom; }
td.n, td.v { font-variant-numeric: tabular-nums; } td.n { color: var(--faint); text-align: right; }
table.verdicts td:nth-child(2) { width: 30%; } table.verdicts td:nth-child(3) { width: 9.5rem; }
tr.total td { font-weight: 600; }
.chips { list-style: none; display: flex; flex-wrap: wrap; gap: .6rem; padding: 0; margin: 0; }
.chips li { padding: .35rem .8rem; border-radius: .5rem; } .chips b { font-size: 1.2em; }
.badge { display: inline-block; padding: .08rem .5rem; border-radius: .4rem; font-size: .8rem; font-weight: 600;
  line-height: 1.4; vertical-align: .08em; }
.holds { color: var(--good); background: var(--good-bg); }
.qualified { color: var(--half); background: var(--half-bg); }
.fails { color: var(--bad); background: var(--bad-bg); } .absent { color: var(--none); background: var(--none-bg); }
td.met, td.yes { color: var(--good); } td.not-met, td.no { color: var(--bad); } td.undecided { color: var(--half); }
td.met, td.not-met, td.undecided, td.yes, td.no { font-weight: 600; white-space: nowrap; }
tr.minor td:nth-child(2) { color: var(--faint); }
.claim, .reading { border-top: 1px solid var(--line); padding-top: 1.2rem; margin-top: 1.8rem; }
.place { color: var(--faint); margin: 0; font-size: .9rem; }
blockquote { margin: .6rem 0; padding: .1rem 0 .1rem .9rem; border-left: 3px solid var(--line); font-style: italic; }
.source, .up { color: var(--faint); font-size: .85rem; } .up { text-align: right; margin: .2rem 0 0; }
details { margin: .4rem 0; } summary { cursor: pointer; color: var(--link); font-size: .92rem; }
details > p { max-width: 46rem; font-size: .92rem; margin: .5rem 0; }
pre { background: var(--card); padding: .8rem; overflow-x: auto; font-size: .8rem; border-radius: .4rem; }
.figures { display: flex; flex-wrap: wrap; gap: 1.2rem; align-items: flex-start; margin-top: .8rem; }
figure { margin: 0 0 .6rem; } figure.plot { flex: 0 1 24rem; max-width: 24rem; }
figure.plot.wide { flex-basis: 100%; max-width: 50rem; }
figure img { display: block; width: 100%; background: #fff; border: 1px solid var(--line);
  border-radius: .35rem; padding: .3rem; }
figcaption { font-size: .84rem; color: var(--faint); margin-top: .35rem; } a.close { display: none; }
figure.plot:target { position: fixed; inset: 0; z-index: 9; margin: 0; max-width: none; overflow: auto;
  padding: 3rem 1rem 1rem;
  background: var(--ground); text-align: center; }
figure.plot:target, figure.plot:target * { outline: none; }
figure.plot:target img { width: auto; max-width: none; max-height: none; margin: 0 auto; }
figure.plot:target a.open { pointer-events: none; }
figure.plot:target figcaption { max-width: 50rem; margin: .6rem auto; }
figure.plot:target a.close { display: block; position: fixed; top: .7rem; right: 1.2rem; }
.box { overflow-x: auto; width: max-content; min-width: 100%; max-width: calc(50% + 50vw - 1.25rem); }
.note { color: var(--faint); font-size: .85rem; margin: .2rem 0 .8rem; }
details.refused { margin: .2rem 0 0; } details.refused summary { font-size: .8rem; }
details.refused ul { margin: .2rem 0; padding-left: 1rem; font-size: .8rem; color: var(--faint); }
table.verdicts td:nth-child(5) { width: 11rem; overflow-wrap: break-word; }
.run { border-top: 1px solid var(--line); margin-top: 2.5rem; } .run h2 { margin: 1.2rem 0 .2rem; }
.run h3 { margin-top: 1.4rem; } .pair { display: flex; flex-wrap: wrap; gap: 0 2.5rem; }
.pair > div { flex: 1 1 20rem; min-width: 0; } .run .box td, .run .box th { white-space: nowrap;
  padding: .34rem .45rem; }
dl { display: grid; grid-template-columns: minmax(7rem, 2fr) 3fr; gap: .25rem 1rem; margin: .6rem 0; font-size: .9rem; }
dt { color: var(--faint); } dd { margin: 0; overflow-wrap: anywhere; font-variant-numeric: tabular-nums; }
.warnings { color: var(--half); background: var(--half-bg); border-radius: .5rem; padding: .1rem 1rem .5rem;
  margin: 1rem 0; } .warnings ul { margin: .3rem 0; padding-left: 1.2rem; }
@media (max-width: 900px) { table.verdicts td:nth-child(2) { width: 24%; }
  table.verdicts td:nth-child(3), table.verdicts td:nth-child(5) { width: 7rem; } }
@media (max-width: 600px) { main { padding: 1.2rem .9rem 3rem; } h1 { font-size: 1.6rem; }
  table.verdicts, table.verdicts tbody { display: block; } table.verdicts thead { display: none; }
  table.verdicts tr { display: block; border: 1px solid var(--line); border-radius: .5rem; padding: .5rem .7rem;
    margin: .7rem 0; }
  table.verdicts td, table.verdicts td:nth-child(n) { display: block; width: auto; border: 0; padding: .15rem 0; }
  table.verdicts td.n { float: left; padding-right: .5rem; }
  table.verdicts td[data-head]::before { content: attr(data-head) ": "; color: var(--faint); font-weight: 600; }
  dl { grid-template-columns: 1fr; gap: 0; } dd { margin-bottom: .4rem; }
  figure.plot, figure.plot.wide { flex-basis: 100%; max-width: 100%; } pre { white-space: pre-wrap; }
  .versions li { overflow-wrap: anywhere; } }
@media print { :root { --ground: #fff; --ink: #000; --faint: #444; --line: #bbb; --card: #f5f5f5; --link: #000;
  --good: #0c5c30; --good-bg: #fff; --half: #6b4600; --half-bg: #fff;
  --bad: #8f1a14; --bad-bg: #fff; --none: #444; --none-bg: #fff; }
  img { filter: none; } @page { margin: 14mm; } html { font-size: 10.5px; } main { max-width: none; padding: 0; }
  nav, .up, .close { display: none !important; } .badge, .chips li { border: 1px solid currentcolor; }
  a { text-decoration: none; } h2, h3 { break-after: avoid; } tr, figure, blockquote { break-inside: avoid; }
  figure.plot { max-width: 8.5cm; } figure.plot.wide { max-width: 17cm; }
  .claim details::details-content { content-visibility: visible; height: auto; } pre { white-space: pre-wrap; } }
"""
