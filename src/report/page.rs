//! Self-contained HTML pages for reports: one file each, complete without scripts or external resources, legible on a
//! phone and on paper, in the reader's light or dark theme.

use std::fmt::{Display, Write};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ImageBuffer, ImageEncoder, ImageError, PixelWithColorType};

use super::plot::Plot;
use insonify_base::output::OutputError;
use insonify_base::output::place::GENERATOR;
use insonify_base::table::Table;
use insonify_base::text::escape;

/// Style sheet. Plots have dark lines without a background; on a dark page their lightness is inverted and their hue
/// kept.
const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1b1f23;--soft:#59636e;--paper:#fff;--card:#f5f7f9;--line:#d6dce2;--good:#00694a;--bad:#b3400a}\
@media(prefers-color-scheme:dark){:root{--ink:#e6e9ec;--soft:#a0abb6;--paper:#14181c;--card:#1e2429;--line:#39424b;--good:#4fd0a5;--bad:#ff9a66}\
figure svg{filter:invert(1) hue-rotate(180deg)}}\
*{box-sizing:border-box}\
body{font:16px/1.55 system-ui,-apple-system,'Segoe UI',sans-serif;color:var(--ink);background:var(--paper);margin:0 auto;padding:1rem;max-width:64rem;overflow-wrap:break-word}\
h1{font-size:1.6rem;line-height:1.25;margin:.5rem 0}h2{font-size:1.3rem;margin:2.5rem 0 .3rem;border-top:1px solid var(--line);padding-top:1.2rem}\
h3{font-size:1.05rem;margin:1.8rem 0 .3rem}p{margin:.5rem 0}.soft{color:var(--soft)}small,.soft{font-size:.9rem}\
a{color:inherit}\
.wide{overflow-x:auto;margin:.6rem 0}\
table{border-collapse:collapse;font-size:.9rem}\
th,td{padding:.3rem .9rem .3rem 0;text-align:left;vertical-align:top;border-bottom:1px solid var(--line)}\
th{font-weight:600;color:var(--soft);vertical-align:bottom}\
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}td.n{white-space:nowrap}\
tr.wrong td{color:var(--bad)}\
.tag{display:inline-block;white-space:nowrap;border:1px solid currentColor;border-radius:.3rem;padding:0 .35rem;font-size:.8rem}\
.tag.good{color:var(--good)}.tag.bad{color:var(--bad);font-weight:600}.tag.plain{color:var(--soft)}\
.advice{background:var(--card);border-left:.3rem solid var(--good);padding:.5rem .8rem;margin:.6rem 0}\
.warning{background:var(--card);border-left:.3rem solid var(--bad);padding:.5rem .8rem;margin:.6rem 0}\
.figures{display:flex;flex-wrap:wrap;gap:1rem 2rem;margin:.8rem 0}\
figure{margin:0;flex:1 1 20rem;max-width:30rem;break-inside:avoid}figcaption{font-size:.9rem;color:var(--soft)}\
svg,img{display:block;width:100%;height:auto}.slider figure{max-width:40rem}.slider input{width:100%;max-width:40rem}figure.whole{max-width:none}\
@media screen{figure.whole svg{width:56rem;max-width:none}}\
details{margin:.6rem 0}summary{cursor:pointer;color:var(--soft);font-size:.9rem}\
@media(max-width:40rem){body{padding:.8rem}table{font-size:.85rem}th,td{padding-right:.6rem}\
figure.whole svg{width:44rem}.stack,.stack tbody{display:block}.stack thead{display:none}.stack tr{display:block;padding:.45rem 0;border-bottom:1px solid var(--line)}\
.stack td{display:block;border:0;padding:0;text-align:left;white-space:normal}.stack td:empty{display:none}\
.stack td[data-label]:not(:first-child)::before{content:attr(data-label) ': ';color:var(--soft)}\
.stack td:first-child{font-weight:600}.stack td:first-child small{font-weight:400}}\
@media print{:root{color-scheme:light;--ink:#000;--soft:#444;--paper:#fff;--card:#f4f4f4;--line:#bbb;--good:#00583e;--bad:#8f3000}\
figure svg{filter:none}body{max-width:none;padding:0;font-size:10pt}.wide{overflow:visible}details,.slider{display:none}\
h2,h3,h2+p,h3+p,h3+p+p,thead,tbody tr:first-child,figcaption{break-after:avoid}tr,.advice,.warning{break-inside:avoid}\
p{orphans:3;widows:3}.figures{display:block}.figures figure{display:inline-block;width:48%;vertical-align:top;margin:0 1% .6rem 0}.advice{break-after:avoid}table{font-size:8pt}}";

/// HTML page under construction.
pub struct Page(String);

impl Page {
    /// Starts a page with a title.
    pub fn new(title: &str) -> Self {
        let title = escape(title);
        // Without a named icon, browsers would request one.
        Page(format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">{GENERATOR}\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><link rel=\"icon\" href=\"data:,\">\
             <title>{title}</title><style>{STYLE}</style></head>\n<body>\n<h1>{title}</h1>\n"
        ))
    }

    /// Adds markup; foreign text in it must be [`escape`]d.
    pub fn put(&mut self, markup: impl Display) {
        // Writing to a string does not fail.
        let _ = writeln!(self.0, "{markup}");
    }

    /// Adds a paragraph with a CSS class.
    pub fn paragraph(&mut self, class: &str, text: &str) {
        self.put(format_args!("<p class=\"{class}\">{}</p>", escape(text)));
    }

    /// Adds a table that scrolls sideways if it is too wide.
    pub fn table(&mut self, table: &Table) {
        self.put(table.html(false));
    }

    /// Adds a table whose rows become blocks on a narrow screen, with the first cell as heading.
    pub fn stacked(&mut self, table: &Table) {
        self.put(table.html(true));
    }

    /// Adds plots beside one another, each with its title as caption.
    ///
    /// # Errors
    /// [`OutputError`] if a plot cannot be drawn.
    pub fn plots<'a>(&mut self, plots: impl IntoIterator<Item = &'a Plot>) -> Result<(), OutputError> {
        self.put("<div class=\"figures\">");
        for plot in plots {
            self.figure(&plot.svg_for_page()?, &plot.title);
        }
        self.put("</div>");
        Ok(())
    }

    /// Adds pictures beside one another, each with a caption; those that cannot be encoded are omitted.
    pub fn pictures<'a, P: PixelWithColorType<Subpixel = u8> + 'a>(
        &mut self,
        pictures: impl IntoIterator<Item = (&'a ImageBuffer<P, Vec<u8>>, String)>,
    ) {
        self.put("<div class=\"figures\">");
        for (picture, caption) in pictures {
            if let Ok(address) = address(picture) {
                self.picture(&address, &caption);
            }
        }
        self.put("</div>");
    }

    /// Adds an SVG figure with a caption.
    fn figure(&mut self, svg: &str, caption: &str) {
        let caption = escape(caption);
        self.put(format_args!(
            "<figure role=\"img\" aria-label=\"{caption}\"><figcaption>{caption}</figcaption>{svg}</figure>"
        ));
    }

    /// Adds an SVG figure of fixed size in a box that scrolls sideways, for lettering that would become too small.
    pub fn wide_figure(&mut self, svg: &str, caption: &str) {
        let caption = escape(caption);
        self.put(format_args!(
            "<figure class=\"whole\" role=\"img\" aria-label=\"{caption}\"><figcaption>{caption}</figcaption><div class=\"wide\">{svg}</div></figure>"
        ));
    }

    /// Adds a picture given by a `data:` address, with a caption.
    fn picture(&mut self, address: &str, caption: &str) {
        let caption = escape(caption);
        self.put(format_args!(
            "<figure><img src=\"{}\" alt=\"{caption}\"><figcaption>{caption}</figcaption></figure>",
            escape(address)
        ));
    }

    /// Adds a slider over pictures, each a `data:` address and a caption; it stays hidden where scripts do not run.
    pub fn slider(&mut self, pictures: &[(String, String)]) {
        let Some(last_index) = pictures.len().checked_sub(1) else {
            return;
        };
        // No string may close the script element.
        let pictures = serde_json::json!(pictures).to_string().replace('<', "\\u003c");
        self.put(format_args!(
            "<div class=\"slider\" hidden><figure><img alt=\"\"><figcaption></figcaption></figure>\
             <input type=\"range\" min=\"0\" max=\"{last_index}\" value=\"0\" aria-label=\"frame\"></div>\n<script>{{\
             const pictures={pictures},box=document.currentScript.previousElementSibling,bar=box.querySelector('input'),\
             show=()=>{{const[at,what]=pictures[bar.value],image=box.querySelector('img');image.src=at;image.alt=what;\
             box.querySelector('figcaption').textContent=what}};bar.oninput=show;show();box.hidden=false}}</script>"
        ));
    }

    /// Returns the complete document.
    pub fn finish(mut self) -> String {
        self.0.push_str("</body></html>\n");
        self.0
    }
}

/// Encodes a picture as a `data:` address.
///
/// # Errors
/// The error of the PNG encoder.
pub fn address<P: PixelWithColorType<Subpixel = u8>>(picture: &ImageBuffer<P, Vec<u8>>) -> Result<String, ImageError> {
    let mut png = Vec::new();
    PngEncoder::new_with_quality(&mut png, CompressionType::Best, FilterType::Adaptive).write_image(
        picture.as_raw(),
        picture.width(),
        picture.height(),
        P::COLOR_TYPE,
    )?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(png)))
}
