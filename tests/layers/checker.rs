//! One source file in, its violations out.

use std::fmt;
use std::path::{Path, PathBuf};

use proc_macro2::{Delimiter, LineColumn, TokenStream, TokenTree};
use syn::visit::{self, Visit};

/// Bottom to top. A layer imports itself and what stands before it.
const LAYERS: [&str; 23] = [
    "error",
    "parallel",
    "progress",
    "math",
    "medium",
    "geometry",
    "light",
    "io",
    "compress",
    "transport",
    "scene",
    "import",
    "asset",
    "evaluate",
    "forms",
    "methods",
    "render",
    "relight",
    "export",
    "measure",
    "report",
    "plan",
    "commands",
];

/// What the program's entry point may name.
const ENTRY: [&str; 2] = ["commands", "error"];

fn rank(layer: &str) -> Option<usize> {
    LAYERS.iter().position(|l| *l == layer)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rule {
    /// From a layer to one above it.
    Upward,
    /// `pub use` of what another layer owns.
    ReExport,
    /// A module without a place in [`LAYERS`].
    Unplaced,
    /// The crate root as a name or a glob: what is taken from it cannot be seen.
    Root,
    /// The run time reads files or a bake.
    RunTime,
    /// A viewer names a method: it knows `dyn Evaluator` only.
    Concrete,
    /// Something that hides paths from this test.
    Hidden,
    /// `lib.rs` holds anything but the layers in their order, re-exports and the functions of the facade.
    Order,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Violation {
    pub(crate) file: String,
    pub(crate) line: usize,
    pub(crate) rule: Rule,
    pub(crate) from: String,
    pub(crate) to: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, line, rule, from, to } = self;
        let why = match rule {
            Rule::Upward => "imports point downwards only",
            Rule::ReExport => "a layer does not re-export what another one owns",
            Rule::Unplaced => "give the module a place in tests/layers.rs",
            Rule::Root => "name the layer, not the crate's root",
            Rule::RunTime => "the run time imports neither `io` nor a `bake`: the asset is all it has",
            Rule::Concrete => "pictures are made through `dyn Evaluator`, whatever the method",
            Rule::Hidden => "this test cannot read through it",
            Rule::Order => {
                "src/lib.rs holds one `pub mod` for each layer, bottom to top, then `use` and public functions, and nothing else"
            }
        };
        write!(f, "src/{file}:{line}: from `{from}` to `{to}`: {why}")
    }
}

/// A module declared without a body: where its file is looked for, below `src/`.
#[derive(Debug)]
pub(crate) struct Declared {
    pub(crate) line: usize,
    pub(crate) module: Vec<String>,
    pub(crate) candidates: Vec<PathBuf>,
}

#[derive(Debug, Default)]
pub(crate) struct Report {
    pub(crate) violations: Vec<Violation>,
    pub(crate) declared: Vec<Declared>,
}

/// Checks one file: `file` below `src/`, `module` its path from the crate's root (empty for `lib.rs` and `main.rs`).
pub(crate) fn check(file: &str, module: &[&str], source: &str) -> Report {
    let mut checker = Checker {
        file,
        module: module.iter().map(ToString::to_string).collect(),
        folders: Vec::new(),
        run_time: run_time(file),
        report: Report::default(),
    };
    match syn::parse_file(source) {
        Ok(tree) => {
            checker.visit_file(&tree);
            if file == "lib.rs" {
                checker.order(&tree);
            }
        }
        Err(error) => {
            let line = error.span().start().line;
            checker.report.violations.push(Violation {
                file: file.into(),
                line,
                rule: Rule::Hidden,
                from: checker.layer(),
                to: format!("syntax: {error}"),
            });
        }
    }
    // The visitor meets some tokens twice (an attribute's path and its list).
    let mut seen: Vec<Violation> = Vec::new();
    for violation in checker.report.violations.drain(..) {
        if !seen.contains(&violation) {
            seen.push(violation);
        }
    }
    seen.sort_by_key(|v| v.line);
    checker.report.violations = seen;
    checker.report
}

/// Whether a file is part of what an engine runs: `evaluate/`, and the evaluators and the GPU parts of each form.
fn run_time(file: &str) -> bool {
    let parts: Vec<&str> = file.split('/').collect();
    let runs = |name: &&str| {
        let stem = name.strip_suffix(".rs").unwrap_or(name);
        matches!(stem, "evaluate" | "evaluator" | "gpu") || stem.ends_with("_gpu")
    };
    match parts.as_slice() {
        ["evaluate", ..] | ["evaluate.rs"] => true,
        ["forms", _, within @ ..] => within.iter().any(runs),
        _ => false,
    }
}

struct Checker<'a> {
    file: &'a str,
    module: Vec<String>,
    /// Names of the inline modules around the current item: their `mod x;` are looked for in a folder of that name.
    folders: Vec<String>,
    run_time: bool,
    report: Report,
}

impl Checker<'_> {
    fn layer(&self) -> String {
        match (self.module.first(), self.file) {
            (Some(first), _) => first.clone(),
            (None, "main.rs") => "main.rs".into(),
            (None, _) => "the crate's root".into(),
        }
    }

    fn found(&mut self, at: LineColumn, rule: Rule, to: &str) {
        let from = self.layer();
        self.report.violations.push(Violation { file: self.file.into(), line: at.line, rule, from, to: to.into() });
    }

    /// A path as written to a path from the crate's root; `None` for other crates and for names in scope here.
    fn resolve(&self, written: &[String]) -> Option<Vec<String>> {
        let mut absolute = match written.first()?.as_str() {
            "crate" | "translux" => Vec::new(),
            "self" => self.module.clone(),
            "super" => {
                let mut up = self.module.clone();
                up.pop();
                up
            }
            // `use` and paths alike: a relative name at the root is a layer.
            first if self.module.is_empty() && self.file == "lib.rs" && rank(first).is_some() => vec![first.into()],
            _ => return None,
        };
        for segment in &written[1..] {
            match segment.as_str() {
                "super" => {
                    absolute.pop();
                }
                "self" => {}
                name => absolute.push(name.into()),
            }
        }
        Some(absolute)
    }

    /// Judges one path. `glob`: it ends in `::*`; `public`: it is re-exported.
    fn judge(&mut self, at: LineColumn, written: &[String], glob: Glob, reach: Reach) {
        let Some(target) = self.resolve(written) else { return };
        let shown = target.join("::");
        let Some(to) = target.first() else {
            self.found(at, Rule::Root, "crate");
            return;
        };
        let Some(to_rank) = rank(to) else {
            self.found(at, Rule::Unplaced, &shown);
            return;
        };
        let from = self.module.first().cloned();
        let own = from.as_ref() == Some(to);
        match from.as_deref().map(rank) {
            Some(Some(from_rank)) if to_rank > from_rank => self.found(at, Rule::Upward, &shown),
            Some(None) => self.found(at, Rule::Unplaced, &self.module.join("::")),
            None if self.file == "main.rs" && !ENTRY.contains(&to.as_str()) => self.found(at, Rule::Upward, &shown),
            _ => {}
        }
        if reach == Reach::Public && !own && self.file != "lib.rs" {
            self.found(at, Rule::ReExport, &shown);
        }
        if matches!(from.as_deref(), Some("render" | "relight" | "export")) && to == "methods" {
            self.found(at, Rule::Concrete, &shown);
        }
        // A glob on the folder of a form takes in the private imports of its mod.rs.
        let laundered = glob == Glob::Yes && target.len() < 3 && to == "forms";
        if self.run_time && (to == "io" || target.iter().any(|s| s == "bake") || laundered) {
            self.found(at, Rule::RunTime, &shown);
        }
    }

    fn use_tree(&mut self, prefix: &mut Vec<String>, tree: &syn::UseTree, reach: Reach) {
        match tree {
            syn::UseTree::Path(path) => {
                prefix.push(path.ident.to_string());
                self.use_tree(prefix, &path.tree, reach);
                prefix.pop();
            }
            syn::UseTree::Name(syn::UseName { ident }) | syn::UseTree::Rename(syn::UseRename { ident, .. }) => {
                prefix.push(ident.to_string());
                self.judge(ident.span().start(), prefix, Glob::No, reach);
                prefix.pop();
            }
            syn::UseTree::Glob(glob) => self.judge(glob.star_token.span.start(), prefix, Glob::Yes, reach),
            syn::UseTree::Group(group) => {
                for item in &group.items {
                    self.use_tree(prefix, item, reach);
                }
            }
        }
    }

    /// Paths in tokens that `syn` does not parse: the bodies of macros and the lists of attributes.
    fn tokens(&mut self, stream: TokenStream) {
        let trees: Vec<TokenTree> = stream.into_iter().collect();
        let mut i = 0;
        while i < trees.len() {
            match &trees[i] {
                TokenTree::Group(group) => self.tokens(group.stream()),
                TokenTree::Ident(ident) if is_start(&ident.to_string()) && separator(&trees, i + 1) => {
                    let mut prefix = vec![ident.to_string()];
                    i = self.token_path(&trees, i + 1, &mut prefix, ident.span().start());
                    continue;
                }
                _ => {}
            }
            i += 1;
        }
    }

    /// Follows `::` from `trees[i]`; returns where the path ends. Braces after `::` are read as a group of a `use`.
    fn token_path(&mut self, trees: &[TokenTree], mut i: usize, prefix: &mut Vec<String>, at: LineColumn) -> usize {
        while separator(trees, i) {
            match trees.get(i + 2) {
                Some(TokenTree::Ident(ident)) => {
                    prefix.push(ident.to_string());
                    i += 3;
                }
                Some(TokenTree::Punct(star)) if star.as_char() == '*' => {
                    self.judge(at, prefix, Glob::Yes, Reach::Private);
                    return i + 3;
                }
                Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Brace => {
                    self.token_group(group.stream(), prefix);
                    return i + 3;
                }
                // `crate::$layer` says nothing; the arguments of a generic end a path that is already known.
                Some(TokenTree::Punct(dollar)) if dollar.as_char() == '$' => {
                    if self.resolve(prefix).is_some_and(|p| p.is_empty()) {
                        self.found(at, Rule::Hidden, &format!("{}::$...", prefix.join("::")));
                        return i + 3;
                    }
                    break;
                }
                _ => break,
            }
        }
        self.judge(at, prefix, Glob::No, Reach::Private);
        i
    }

    fn token_group(&mut self, stream: TokenStream, prefix: &[String]) {
        let trees: Vec<TokenTree> = stream.into_iter().collect();
        for item in trees.split(|t| matches!(t, TokenTree::Punct(p) if p.as_char() == ',')) {
            let Some(first) = item.first() else { continue };
            let at = first.span().start();
            let mut path = prefix.to_vec();
            match first {
                TokenTree::Ident(ident) => {
                    path.push(ident.to_string());
                    self.token_path(item, 1, &mut path, at);
                }
                TokenTree::Punct(star) if star.as_char() == '*' => self.judge(at, &path, Glob::Yes, Reach::Private),
                _ => self.found(at, Rule::Hidden, &format!("{}::{{...}}", prefix.join("::"))),
            }
        }
    }

    /// Paths in the strings of an attribute: `#[serde(default = "crate::...")]` calls what it names.
    fn strings(&mut self, stream: TokenStream) {
        for tree in stream {
            match tree {
                TokenTree::Group(group) => self.strings(group.stream()),
                TokenTree::Literal(literal) => {
                    let Ok(text) = syn::parse_str::<syn::LitStr>(&literal.to_string()) else { continue };
                    let Ok(path) = text.parse::<syn::Path>() else { continue };
                    let path = segments(&path);
                    if path.len() > 1 {
                        self.judge(literal.span().start(), &path, Glob::No, Reach::Private);
                    }
                }
                _ => {}
            }
        }
    }

    fn declare(&mut self, item: &syn::ItemMod) {
        let name = item.ident.to_string();
        let at = item.ident.span().start();
        let mut module = self.module.clone();
        module.push(name.clone());
        let here = Path::new(self.file);
        let folder = here.parent().unwrap_or(Path::new(""));
        // x.rs keeps its children in x/, mod.rs and lib.rs beside themselves.
        let own = match here.file_stem().and_then(|s| s.to_str()) {
            Some("mod" | "lib" | "main") | None => folder.to_path_buf(),
            Some(stem) => folder.join(stem),
        };
        let own = self.folders.iter().fold(own, |p, f| p.join(f));
        let mut candidates = vec![own.join(format!("{name}.rs")), own.join(&name).join("mod.rs")];
        for attribute in item.attrs.iter().filter(|a| a.path().is_ident("path")) {
            let file = match &attribute.meta {
                syn::Meta::NameValue(syn::MetaNameValue { value: syn::Expr::Lit(literal), .. }) => match &literal.lit {
                    syn::Lit::Str(text) => text.value(),
                    _ => String::new(),
                },
                _ => String::new(),
            };
            // A file of another folder would be this layer by name and another one by place.
            if !self.folders.is_empty() || file.is_empty() || file.contains(['/', '\\']) {
                self.found(at, Rule::Hidden, &format!("#[path = \"{file}\"]"));
            }
            candidates = vec![folder.join(file)];
        }
        self.report.declared.push(Declared { line: at.line, module, candidates });
    }

    fn order(&mut self, tree: &syn::File) {
        let mut above = None;
        for item in &tree.items {
            let at = syn::spanned::Spanned::span(item).start();
            match item {
                syn::Item::Mod(m) if m.content.is_none() && matches!(m.vis, syn::Visibility::Public(_)) => {
                    let name = m.ident.to_string();
                    let place = rank(&name);
                    match place {
                        None => self.found(m.ident.span().start(), Rule::Unplaced, &name),
                        Some(_) if place <= above => self.found(m.ident.span().start(), Rule::Order, &name),
                        Some(_) => above = place,
                    }
                }
                // The facade: the only place that re-exports what a layer owns, and functions of a few lines over several layers.
                syn::Item::Use(_) if above.is_some() => {}
                syn::Item::Fn(f) if above.is_some() && matches!(f.vis, syn::Visibility::Public(_)) => {}
                _ => self.found(at, Rule::Order, "another item"),
            }
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Glob {
    Yes,
    No,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Reach {
    Private,
    Public,
}

fn is_start(ident: &str) -> bool {
    matches!(ident, "crate" | "super" | "self" | "translux")
}

fn separator(trees: &[TokenTree], i: usize) -> bool {
    let colon = |t: Option<&TokenTree>| matches!(t, Some(TokenTree::Punct(p)) if p.as_char() == ':');
    colon(trees.get(i)) && colon(trees.get(i + 1))
}

fn segments(path: &syn::Path) -> Vec<String> {
    path.segments.iter().map(|s| s.ident.to_string()).collect()
}

impl<'ast> Visit<'ast> for Checker<'_> {
    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        let reach = match item.vis {
            syn::Visibility::Inherited => Reach::Private,
            _ => Reach::Public,
        };
        self.use_tree(&mut Vec::new(), &item.tree, reach);
        for attribute in &item.attrs {
            self.visit_attribute(attribute);
        }
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        // A lone `self` or `crate` is a value or a visibility.
        if let Some(first) = path.segments.first()
            && path.segments.len() > 1
        {
            self.judge(first.ident.span().start(), &segments(path), Glob::No, Reach::Private);
        }
        visit::visit_path(self, path);
    }

    /// `pub(in crate::x)` narrows, it takes nothing.
    fn visit_vis_restricted(&mut self, _: &'ast syn::VisRestricted) {}

    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        if call.path.segments.last().is_some_and(|s| s.ident == "include") {
            let at = syn::spanned::Spanned::span(&call.path).start();
            self.found(at, Rule::Hidden, "include!");
        }
        self.tokens(call.tokens.clone());
        visit::visit_macro(self, call);
    }

    fn visit_attribute(&mut self, attribute: &'ast syn::Attribute) {
        if attribute.path().is_ident("doc") {
            return;
        }
        if let syn::Meta::List(list) = &attribute.meta {
            self.tokens(list.tokens.clone());
            self.strings(list.tokens.clone());
        }
        visit::visit_attribute(self, attribute);
    }

    fn visit_item_extern_crate(&mut self, item: &'ast syn::ItemExternCrate) {
        if item.ident == "self" || item.rename.is_some() {
            self.found(item.ident.span().start(), Rule::Hidden, &format!("extern crate {}", item.ident));
        }
    }

    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if item.content.is_none() {
            self.declare(item);
            return;
        }
        if item.attrs.iter().any(|a| a.path().is_ident("path")) {
            self.found(item.ident.span().start(), Rule::Hidden, "#[path] on an inline module");
        }
        let name = item.ident.to_string();
        self.module.push(name.clone());
        self.folders.push(name);
        visit::visit_item_mod(self, item);
        self.folders.pop();
        self.module.pop();
    }
}
