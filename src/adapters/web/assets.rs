//! Style sheet and scripts: compiled in, addressed by their content, cached for good.

use std::sync::LazyLock;

use axum::{
    extract::Path,
    http::{StatusCode, header},
    response::{IntoResponse, Response},
};
use sha2::{Digest, Sha256};

use crate::adapters::http::token::hexadecimal;

/// Name, content type and content of every asset.
const ASSETS: [(&str, &str, &str); 6] = [
    (
        "app.css",
        "text/css; charset=utf-8",
        include_str!("static/app.css"),
    ),
    ("theme.js", SCRIPT, include_str!("static/theme.js")),
    ("app.js", SCRIPT, include_str!("static/app.js")),
    ("chart.js", SCRIPT, include_str!("static/chart.js")),
    ("draw.js", SCRIPT, include_str!("static/draw.js")),
    ("icon.svg", "image/svg+xml", include_str!("static/icon.svg")),
];
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// What the addresses of this build's assets begin with. All change when one does: modules name
/// each other without knowing their hashes.
static BASE: LazyLock<String> = LazyLock::new(|| {
    let mut hash = Sha256::new();
    for (name, _, content) in ASSETS {
        hash.update(name);
        hash.update(content);
    }
    let digest = hash.finalize();
    let mark = hexadecimal(&digest[..6]);
    format!("/static/{mark}/")
});

/// Address of an asset.
pub(super) fn address(name: &str) -> String {
    format!("{}{name}", *BASE)
}

/// `GET /static/{mark}/{name}`.
pub(super) async fn serve(Path((mark, name)): Path<(String, String)>) -> Response {
    let current = BASE.split('/').any(|part| part == mark);
    let found = ASSETS.iter().find(|(known, _, _)| *known == name);
    match found {
        Some((_, content_type, content)) if current => (
            [
                (header::CONTENT_TYPE, *content_type),
                (header::CACHE_CONTROL, "public, max-age=31536000, immutable"),
            ],
            *content,
        )
            .into_response(),
        _ => StatusCode::NOT_FOUND.into_response(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scripts_import_nothing_from_elsewhere() {
        for (name, _, content) in ASSETS {
            for word in ["http://", "https://", "//cdn", "@import"] {
                let foreign = content.replace("http://www.w3.org/", "");
                assert!(!foreign.contains(word), "{name} names {word}");
            }
        }
    }
}
