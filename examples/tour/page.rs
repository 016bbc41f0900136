//! A page without outside parts: pictures and plots are inside the file.

use base64::Engine;
use plotters::prelude::*;
use std::fmt::Write;

/// A page under construction.
pub struct Page {
    body: String,
}

const STYLE: &str = "
:root{color-scheme:light dark}
body{font:16px/1.5 system-ui,sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem}
h1,h2{line-height:1.2}
table{border-collapse:collapse;margin:1rem 0;font-variant-numeric:tabular-nums}
th,td{padding:.3rem .8rem;text-align:right;border-bottom:1px solid #8884}
th:first-child,td:first-child{text-align:left}
.frames{display:grid;grid-template-columns:repeat(auto-fill,minmax(20rem,1fr));gap:1rem}
figure{margin:0}
img,svg{max-width:100%;height:auto;border-radius:4px}
figcaption{font-size:.85rem;opacity:.8}
.note{opacity:.8}
pre{overflow-x:auto;font-size:.85rem;padding:.5rem;background:#8881}
.wide{overflow-x:auto}
";

impl Page {
    /// A page with a title and a sentence below it.
    pub fn new(title: &str, subtitle: &str) -> Self {
        let (title, subtitle) = (escape(title), escape(subtitle));
        let head = format!(
            "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
             <title>{title}</title><style>{STYLE}</style></head><body><h1>{title}</h1><p>{subtitle}</p>\n"
        );
        Self { body: head }
    }

    /// A section heading.
    pub fn heading(&mut self, text: &str) {
        writeln!(self.body, "<h2>{}</h2>", escape(text)).expect("writing to a string");
    }

    /// A paragraph.
    pub fn paragraph(&mut self, text: &str) {
        writeln!(self.body, "<p class=\"note\">{}</p>", escape(text)).expect("writing to a string");
    }

    /// Text as it is, under a summary that unfolds.
    pub fn details(&mut self, summary: &str, text: &str) {
        let (summary, text) = (escape(summary), escape(text));
        writeln!(self.body, "<details><summary>{summary}</summary><pre>{text}</pre></details>")
            .expect("writing to a string");
    }

    /// A table; the first row is the head.
    pub fn table(&mut self, rows: &[Vec<String>]) {
        self.body.push_str("<div class=\"wide\"><table>");
        for (i, row) in rows.iter().enumerate() {
            let tag = if i == 0 { "th" } else { "td" };
            self.body.push_str("<tr>");
            for cell in row {
                write!(self.body, "<{tag}>{}</{tag}>", escape(cell)).expect("writing to a string");
            }
            self.body.push_str("</tr>\n");
        }
        self.body.push_str("</table></div>\n");
    }

    /// Pictures (PNG bytes) with captions, side by side as far as the window allows.
    pub fn pictures(&mut self, pictures: &[(Vec<u8>, String)]) {
        self.body.push_str("<div class=\"frames\">");
        for (png, caption) in pictures {
            let caption = escape(caption);
            let data = base64::engine::general_purpose::STANDARD.encode(png);
            writeln!(
                self.body,
                "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\">\
                 <figcaption>{caption}</figcaption></figure>"
            )
            .expect("writing to a string");
        }
        self.body.push_str("</div>\n");
    }

    /// Lines over the frame number.
    ///
    /// # Errors
    /// When the plot cannot be drawn.
    pub fn plot(
        &mut self,
        title: &str,
        unit: &str,
        lines: &[(&str, Vec<f64>)],
    ) -> Result<(), Box<dyn std::error::Error>> {
        let mut svg = String::new();
        draw(&mut svg, title, unit, lines)?;
        self.body.push_str("<figure>");
        self.body.push_str(&svg);
        self.body.push_str("</figure>\n");
        Ok(())
    }

    /// The finished page.
    pub fn finish(mut self) -> String {
        self.body.push_str("</body></html>\n");
        self.body
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn draw(
    svg: &mut String,
    title: &str,
    unit: &str,
    lines: &[(&str, Vec<f64>)],
) -> Result<(), Box<dyn std::error::Error>> {
    let colours =
        [RGBColor(0, 90, 181), RGBColor(220, 50, 32), RGBColor(30, 136, 60), RGBColor(148, 80, 170)];
    let frames = lines.iter().map(|l| l.1.len()).max().unwrap_or(1).max(2);
    let top = lines.iter().flat_map(|l| l.1.iter().copied()).fold(0.0, f64::max) * 1.35 + 1e-9;
    let root = SVGBackend::with_string(svg, (860, 300)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption(title, ("sans-serif", 18))
        .margin(10)
        .x_label_area_size(36)
        .y_label_area_size(64)
        .build_cartesian_2d(0..frames - 1, 0.0..top)?;
    chart.configure_mesh().x_desc("frame").y_desc(unit).light_line_style(WHITE).draw()?;
    for (i, (name, values)) in lines.iter().enumerate() {
        let colour = colours[i % colours.len()];
        chart
            .draw_series(LineSeries::new(values.iter().copied().enumerate(), colour.stroke_width(2)))?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK)
        .draw()?;
    root.present()?;
    drop(chart);
    Ok(())
}
