//! Key expressions: how they are built, and what a key says.

/// Builds and reads the keys below one prefix.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Keys {
    prefix: String,
}

/// What a key of an incoming message says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// `<prefix>/measurement/<site>/<stream>`.
    Measurement {
        /// Site.
        site: String,
        /// Stream.
        stream: String,
    },
    /// `<prefix>/recording/<site>/<recorder>`.
    Recording {
        /// Site.
        site: String,
        /// Recorder.
        recorder: String,
    },
}

impl Keys {
    /// Keys below `prefix`.
    #[must_use]
    pub fn new(prefix: &str) -> Self {
        Self {
            prefix: prefix.trim_matches('/').to_owned(),
        }
    }

    /// Sample batches of one stream.
    #[must_use]
    pub fn measurement(&self, site: &str, stream: &str) -> String {
        format!("{}/measurement/{site}/{stream}", self.prefix)
    }

    /// The configuration of a stream of C37.118 frames, as its source answers who asks for it.
    #[must_use]
    pub fn configuration(&self, site: &str, stream: &str) -> String {
        format!("{}/configuration/{site}/{stream}", self.prefix)
    }

    /// Recordings of one recorder.
    #[must_use]
    pub fn recording(&self, site: &str, recorder: &str) -> String {
        format!("{}/recording/{site}/{recorder}", self.prefix)
    }

    /// Parameter sets of one site (`*` for all).
    #[must_use]
    pub fn parameters(&self, site: &str) -> String {
        format!("{}/parameters/{site}", self.prefix)
    }

    /// Diagnoses of one site (`*` for all).
    #[must_use]
    pub fn diagnosis(&self, site: &str) -> String {
        format!("{}/diagnosis/{site}", self.prefix)
    }

    /// Event summaries of one site (`*` for all).
    #[must_use]
    pub fn event(&self, site: &str) -> String {
        format!("{}/event/{site}", self.prefix)
    }

    /// Liveliness token and status of one instance (`*` for all).
    #[must_use]
    pub fn status(&self, instance: &str) -> String {
        format!("{}/status/{instance}", self.prefix)
    }

    /// All incoming messages of one kind.
    #[must_use]
    pub fn all(&self, kind: &str) -> String {
        format!("{}/{kind}/**", self.prefix)
    }

    /// The site of a parameters key; none when it is another key.
    #[must_use]
    pub fn site_of_parameters<'k>(&self, key: &'k str) -> Option<&'k str> {
        self.site_below("/parameters/", key)
    }

    /// The site of a diagnosis key; none when it is another key.
    #[must_use]
    pub fn site_of_diagnosis<'k>(&self, key: &'k str) -> Option<&'k str> {
        self.site_below("/diagnosis/", key)
    }

    fn site_below<'k>(&self, kind: &str, key: &'k str) -> Option<&'k str> {
        let rest = key.strip_prefix(&self.prefix)?.strip_prefix(kind)?;
        (!rest.is_empty() && !rest.contains('/')).then_some(rest)
    }

    /// What an incoming key says; none when it is not of the documented form.
    #[must_use]
    pub fn address(&self, key: &str) -> Option<Address> {
        let rest = key.strip_prefix(&self.prefix)?.strip_prefix('/')?;
        let mut chunks = rest.split('/');
        let (kind, site, source) = (chunks.next()?, chunks.next()?, chunks.next()?);
        if chunks.next().is_some() {
            return None;
        }
        let (site, source) = (site.to_owned(), source.to_owned());
        match kind {
            "measurement" => Some(Address::Measurement {
                site,
                stream: source,
            }),
            "recording" => Some(Address::Recording {
                site,
                recorder: source,
            }),
            _ => None,
        }
    }
}

/// Whether `name` may be one chunk of a key expression.
#[must_use]
pub fn is_chunk(name: &str) -> bool {
    !name.is_empty()
        && !name
            .chars()
            .any(|c| matches!(c, '/' | '*' | '$' | '?' | '#') || c.is_whitespace())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_read_as_it_was_built() {
        let keys = Keys::new("loadmodel/v1");
        assert_eq!(
            keys.address(&keys.measurement("north", "pmu-1")),
            Some(Address::Measurement {
                site: "north".to_owned(),
                stream: "pmu-1".to_owned()
            })
        );
        assert_eq!(
            keys.address(&keys.recording("north", "dfr")),
            Some(Address::Recording {
                site: "north".to_owned(),
                recorder: "dfr".to_owned()
            })
        );
        assert_eq!(
            keys.site_of_parameters(&keys.parameters("north")),
            Some("north")
        );
        let diagnosis = keys.diagnosis("north");
        assert_eq!(keys.site_of_diagnosis(&diagnosis), Some("north"));
        assert_eq!(keys.site_of_parameters(&diagnosis), None);
    }

    #[test]
    fn a_key_of_another_form_says_nothing() {
        let keys = Keys::new("loadmodel/v1/");
        for key in [
            "loadmodel/v1/measurement/north",
            "loadmodel/v1/measurement/north/pmu/1",
            "loadmodel/v1/other/north/pmu",
            "loadmodel/v2/measurement/north/pmu",
        ] {
            assert_eq!(keys.address(key), None, "{key}");
        }
    }

    #[test]
    fn a_chunk_holds_no_wildcard_and_no_space() {
        assert!(is_chunk("site-02"));
        for name in ["", "a/b", "a*", "a b", "$a", "a?", "a#"] {
            assert!(!is_chunk(name), "{name}");
        }
    }
}
