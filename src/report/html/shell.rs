//! What every page has around its content: head, style, scripts, and no way out to the network.

use std::fmt::Write;

const STYLE: &str = include_str!("page.css");
const SCRIPT: [&str; 3] = [include_str!("pixels.js"), include_str!("viewer.js"), include_str!("page.js")];

/// A page. Title and body are HTML; `data` stands between body and scripts, which sort tables and show pixels.
pub fn shell(title: &str, body: &str, data: &str, scripts: bool) -> String {
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"generator\" content=\"lacuna\">\n<title>{title}</title>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data: blob:; \
         style-src 'unsafe-inline'; script-src 'unsafe-inline'\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<style>\n{STYLE}</style>\n</head>\n<body>\n{body}{data}"
    );
    for script in SCRIPT.iter().filter(|_| scripts) {
        let _ = write!(page, "<script>\n{script}</script>\n");
    }
    page.push_str("</body>\n</html>\n");
    page
}
