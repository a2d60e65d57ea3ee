//! The `OpenAPI` document, and that it says what there is.

use axum::{
    http::header,
    response::{IntoResponse, Response},
};

const DOCUMENT: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/openapi.json"));

/// `/api/v1/openapi.json`.
pub(super) async fn document() -> Response {
    ([(header::CONTENT_TYPE, "application/json")], DOCUMENT).into_response()
}

#[cfg(test)]
mod tests {
    use std::{fs, path::Path};

    use serde_json::Value;

    use super::*;
    use crate::adapters::web::testing::Server;

    fn documented() -> Vec<(String, String)> {
        let document: Value = serde_json::from_str(DOCUMENT).unwrap();
        let paths = document["paths"].as_object().unwrap();
        let methods = paths.iter().flat_map(|(path, item)| {
            let methods = item.as_object().unwrap().keys();
            methods.map(|method| (method.clone(), path.clone()))
        });
        methods.collect()
    }

    /// The first argument of every `.route(...)` of a source file.
    fn routes(file: &str) -> Vec<String> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
        let text = fs::read_to_string(path).unwrap();
        let code = text.split("#[cfg(test)]").next().unwrap_or("");
        let calls = code.split(".route(").skip(1);
        calls
            .filter_map(|rest| rest.trim_start().strip_prefix('"')?.split('"').next())
            .map(str::to_owned)
            .collect()
    }

    #[test]
    fn every_route_of_the_api_is_documented() {
        let documented = documented();
        let mut count = 0;
        for file in [
            "src/adapters/http/api.rs",
            "src/adapters/http/actions.rs",
            "src/adapters/http/server.rs",
        ] {
            for route in routes(file) {
                let known = documented.iter().any(|(_, path)| *path == route);
                assert!(known, "{route} of {file} is not in docs/openapi.json");
                count += 1;
            }
        }
        assert!(count > 12, "only {count} routes were found in the sources");
    }

    #[test]
    fn both_twins_of_every_page_are_documented() {
        let documented = documented();
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/adapters/web/routes.rs");
        let text = fs::read_to_string(path).unwrap();
        let (_, pages) = text.split_once("for (path, page) in [").unwrap();
        let (pages, _) = pages.split_once("] {").unwrap();
        let pages: Vec<&str> = pages.split('"').skip(1).step_by(2).collect();
        assert!(pages.len() > 8, "only {pages:?} were found in the sources");
        for page in pages {
            for ending in [".json", ".csv"] {
                let twin = format!("{page}{ending}");
                let known = documented.contains(&("get".to_owned(), twin.clone()));
                assert!(known, "{twin} is not in docs/openapi.json");
            }
        }
    }

    #[tokio::test]
    async fn everything_documented_is_there() {
        let server = Server::start().await;
        let mut missing = Vec::new();
        for (method, path) in documented() {
            let address = path
                .replace("{site}", "site-01")
                .replace("{event}", &server.event)
                .replace("{version}", "1")
                .replace("{name}", "exponential_recovery")
                .replace("{id}", "1");
            let answer = server.ask(&method.to_uppercase(), &address, &[], "").await;
            // A path that leads nowhere is told by these words; one that leads to nothing stored
            // names what it looked for.
            let nowhere = answer.body.contains("there is nothing at") || answer.status == 405;
            if nowhere {
                missing.push(format!("{method} {path}: {}", answer.status));
            }
        }
        assert!(missing.is_empty(), "documented but not there: {missing:#?}");
    }
}
