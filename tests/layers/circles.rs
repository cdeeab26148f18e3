//! Circles of imports between the files of a crate.
//!
//! A file depends on another one when its code (tests apart) names something that the other one defines. Names are followed
//! through re-exports to the file that defines them, so a `mod.rs` that only declares and re-exports is part of no circle.

use std::collections::{BTreeMap, BTreeSet};

use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// A path from the crate's root, or as written: the names between its `::`.
type Names = Vec<String>;

/// One file without its test code.
#[derive(Debug, Default)]
pub(crate) struct Source {
    /// Name of the file below the source folder.
    file: String,
    /// Every path outside `use`, with its line and the module that it is written in.
    paths: Vec<(usize, Names, Names)>,
    /// Every import: line, module that it is written in, path as written, name that it gets, whether it is a re-export.
    imports: Vec<Import>,
    /// Names outside `use`, alone or in paths.
    mentioned: BTreeSet<String>,
    /// Names of items.
    defined: BTreeSet<String>,
    /// Modules declared or defined here, as paths from the crate's root, with whether they are test code.
    modules: Vec<(Names, Code)>,
}

#[derive(Debug)]
struct Import {
    line: usize,
    module: Names,
    path: Names,
    /// `None` for a glob.
    name: Option<String>,
    public: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Code {
    Product,
    Test,
}

impl Source {
    /// Reads `file`, whose module has the path `module` from the crate's root.
    pub(crate) fn read(file: &str, module: &[String], text: &str) -> Self {
        let mut source = Self { file: file.into(), ..Self::default() };
        // What cannot be read is a violation of its own (`Rule::Hidden`).
        if let Ok(tokens) = text.parse::<TokenStream>() {
            source.tokens(tokens, module);
        }
        source
    }

    fn tokens(&mut self, stream: TokenStream, module: &[String]) {
        let trees: Vec<TokenTree> = stream.into_iter().collect();
        let mut i = 0;
        let mut test = Code::Product;
        while i < trees.len() {
            match &trees[i] {
                TokenTree::Punct(p) if p.as_char() == '#' => {
                    if let Some(TokenTree::Group(attribute)) = trees.get(i + 1)
                        && attribute.delimiter() == Delimiter::Bracket
                    {
                        if is_test(attribute.stream()) {
                            test = Code::Test;
                        } else if !word(attribute.stream().into_iter().next().as_ref(), "doc") {
                            self.tokens(attribute.stream(), module);
                        }
                        i += 2;
                        continue;
                    }
                }
                _ if test == Code::Test => {
                    let end = item_end(&trees, i);
                    if let Some(at) = (i..end).find(|k| word(trees.get(*k), "mod"))
                        && let Some(TokenTree::Ident(name)) = trees.get(at + 1)
                    {
                        self.modules.push((below(module, &name.to_string()), Code::Test));
                    }
                    i = end;
                    test = Code::Product;
                    continue;
                }
                TokenTree::Ident(ident) if ident == "use" && !punct(trees.get(i + 1), '<') => {
                    let public = match i.checked_sub(1).map(|k| &trees[k]) {
                        Some(TokenTree::Ident(word)) => word == "pub",
                        Some(TokenTree::Group(reach)) => {
                            reach.delimiter() == Delimiter::Parenthesis && i > 1 && word(trees.get(i - 2), "pub")
                        }
                        _ => false,
                    };
                    let end = (i..trees.len()).find(|k| punct(trees.get(*k), ';')).unwrap_or(trees.len());
                    let tree: TokenStream = trees[i + 1..end].iter().cloned().collect();
                    if let Ok(tree) = syn::parse2::<syn::UseTree>(tree) {
                        self.import(&tree, &mut Vec::new(), module, public);
                    }
                    i = end + 1;
                    continue;
                }
                TokenTree::Ident(ident) if ident == "mod" => {
                    if let Some(TokenTree::Ident(name)) = trees.get(i + 1) {
                        let inner = below(module, &name.to_string());
                        self.modules.push((inner.clone(), Code::Product));
                        if let Some(TokenTree::Group(body)) = trees.get(i + 2) {
                            self.tokens(body.stream(), &inner);
                        }
                        i += 3;
                        continue;
                    }
                }
                TokenTree::Ident(ident) => {
                    let line = ident.span().start().line;
                    let mut path = vec![ident.to_string()];
                    let keyword = ["fn", "struct", "enum", "trait", "type", "const", "static", "union"];
                    if keyword.iter().any(|k| ident == k)
                        && let Some(TokenTree::Ident(name)) = trees.get(i + 1)
                    {
                        self.defined.insert(name.to_string());
                    }
                    if ident == "macro_rules"
                        && let Some(TokenTree::Ident(name)) = trees.get(i + 2)
                    {
                        self.defined.insert(name.to_string());
                    }
                    // A name after a single dot is a field or a method; `::name` goes on from a type (`<T>::name`).
                    let dot = i > 0 && punct(trees.get(i - 1), '.') && !(i > 1 && punct(trees.get(i - 2), '.'));
                    let relative = !(dot || i > 1 && double_colon(&trees, i - 2));
                    while double_colon(&trees, i + 1)
                        && let Some(TokenTree::Ident(next)) = trees.get(i + 3)
                    {
                        path.push(next.to_string());
                        i += 3;
                    }
                    if relative {
                        self.mentioned.insert(path[0].clone());
                        if path.len() > 1 {
                            self.paths.push((line, module.to_vec(), path));
                        }
                    }
                }
                TokenTree::Group(group) => self.tokens(group.stream(), module),
                TokenTree::Literal(literal) => {
                    // `#[serde(with = "super::x")]` calls what it names.
                    if let Ok(text) = syn::parse_str::<syn::LitStr>(&literal.to_string())
                        && let Ok(path) = text.parse::<syn::Path>()
                        && ["crate", "super", "self"].iter().any(|s| path.segments[0].ident == s)
                    {
                        let names = path.segments.iter().map(|s| s.ident.to_string()).collect();
                        self.paths.push((literal.span().start().line, module.to_vec(), names));
                    }
                }
                TokenTree::Punct(_) => {}
            }
            i += 1;
        }
    }

    fn import(&mut self, tree: &syn::UseTree, prefix: &mut Names, module: &[String], public: bool) {
        let mut add = |line, path: Names, name| {
            self.imports.push(Import { line, module: module.to_vec(), path, name, public });
        };
        match tree {
            syn::UseTree::Path(path) => {
                prefix.push(path.ident.to_string());
                self.import(&path.tree, prefix, module, public);
                prefix.pop();
            }
            syn::UseTree::Name(name) => {
                let mut path = prefix.clone();
                if name.ident != "self" || path.is_empty() {
                    path.push(name.ident.to_string());
                }
                let last = path.last().cloned();
                add(name.ident.span().start().line, path, last);
            }
            syn::UseTree::Rename(rename) => {
                let mut path = prefix.clone();
                if rename.ident != "self" || path.is_empty() {
                    path.push(rename.ident.to_string());
                }
                add(rename.ident.span().start().line, path, Some(rename.rename.to_string()));
            }
            syn::UseTree::Glob(glob) => add(glob.star_token.span.start().line, prefix.clone(), None),
            syn::UseTree::Group(group) => {
                for item in &group.items {
                    self.import(item, prefix, module, public);
                }
            }
        }
    }
}

fn below(module: &[String], name: &str) -> Names {
    module.iter().cloned().chain([name.to_string()]).collect()
}

fn punct(tree: Option<&TokenTree>, c: char) -> bool {
    matches!(tree, Some(TokenTree::Punct(p)) if p.as_char() == c)
}

fn word(tree: Option<&TokenTree>, name: &str) -> bool {
    matches!(tree, Some(TokenTree::Ident(ident)) if ident == name)
}

fn double_colon(trees: &[TokenTree], i: usize) -> bool {
    punct(trees.get(i), ':') && punct(trees.get(i + 1), ':')
}

/// Whether an attribute (without `#[]`) keeps its item out of the product: `test`, `cfg(test)`, `cfg(all(test, ...))`.
fn is_test(attribute: TokenStream) -> bool {
    let trees: Vec<TokenTree> = attribute.into_iter().collect();
    match trees.as_slice() {
        [only] => word(Some(only), "test"),
        [first, TokenTree::Group(group)] if word(Some(first), "cfg") => {
            let inner: Vec<TokenTree> = group.stream().into_iter().collect();
            match inner.as_slice() {
                [only] => word(Some(only), "test"),
                [all, TokenTree::Group(group)] if word(Some(all), "all") => {
                    group.stream().into_iter().any(|t| word(Some(&t), "test"))
                }
                _ => false,
            }
        }
        _ => false,
    }
}

/// Where the item or field that starts at `trees[i]` ends: behind its `;`, its body or, for a field, its comma.
fn item_end(trees: &[TokenTree], start: usize) -> usize {
    let visibility = match (trees.get(start), trees.get(start + 1)) {
        (Some(TokenTree::Ident(word)), Some(TokenTree::Group(_))) if word == "pub" => 2,
        (Some(TokenTree::Ident(word)), _) if word == "pub" => 1,
        _ => 0,
    };
    let at = start + visibility;
    let field = punct(trees.get(at + 1), ':') && !punct(trees.get(at + 2), ':');
    let statement = ["use", "const", "static", "let", "type"].iter().any(|k| word(trees.get(at), k))
        && !word(trees.get(at + 1), "fn");
    for (i, tree) in trees.iter().enumerate().skip(start) {
        match tree {
            TokenTree::Punct(p) if p.as_char() == ';' || (field && p.as_char() == ',') => return i + 1,
            TokenTree::Group(g) if g.delimiter() == Delimiter::Brace && !field && !statement => return i + 1,
            _ => {}
        }
    }
    trees.len()
}

/// One dependency of a file on another one: the line of its first cause, and the path there.
#[derive(Clone, Debug)]
pub(crate) struct Cause {
    line: usize,
    path: String,
}

/// The files of a crate by their modules.
pub(crate) struct Crate<'a> {
    modules: BTreeMap<Names, &'a Source>,
}

impl<'a> Crate<'a> {
    /// `sources` with the paths of their modules; files that only tests reach are left out.
    pub(crate) fn new(sources: &'a [(Names, Source)]) -> Self {
        let tests: BTreeSet<&Names> = sources
            .iter()
            .flat_map(|(_, s)| s.modules.iter().filter(|(_, code)| *code == Code::Test).map(|(m, _)| m))
            .collect();
        let tested = |module: &Names| (1..=module.len()).any(|n| tests.contains(&module[..n].to_vec()));
        Self { modules: sources.iter().filter(|(m, _)| !tested(m)).map(|(m, s)| (m.clone(), s)).collect() }
    }

    /// The file that holds the module or item at `path`, and what of the path is left inside it.
    fn file<'p>(&self, path: &'p [String]) -> Option<(&'a Source, &'p [String])> {
        (0..=path.len()).rev().find_map(|n| Some((*self.modules.get(&path[..n])?, &path[n..])))
    }

    /// A path as written in `module` of `source` to a path from the crate's root; `None` for other crates and local names.
    fn absolute(&self, source: &Source, module: &[String], written: &[String]) -> Option<Names> {
        let (mut path, rest) = match written.first()?.as_str() {
            "crate" | "translux" => (Vec::new(), &written[1..]),
            "self" => (module.to_vec(), &written[1..]),
            "super" => (module[..module.len().checked_sub(1)?].to_vec(), &written[1..]),
            first => {
                let child = below(module, first);
                if source.modules.iter().any(|(m, _)| *m == child) {
                    (module.to_vec(), written)
                } else {
                    // A name in scope: something imported, if it is a path into this crate.
                    let named = |i: &&Import| i.module == module && i.name.as_deref() == Some(first);
                    let import = source.imports.iter().find(named)?;
                    if import.path.first().map(String::as_str) == Some(first) {
                        return None;
                    }
                    (self.absolute(source, module, &import.path)?, &written[1..])
                }
            }
        };
        for name in rest {
            match name.as_str() {
                "super" => {
                    path.pop();
                }
                "self" => {}
                name => path.push(name.into()),
            }
        }
        Some(path)
    }

    /// The file that defines what `path` names, through the imports of the files on the way.
    fn definer(&self, path: &[String], depth: usize) -> Option<&'a Source> {
        let (source, rest) = self.file(path)?;
        let module = &path[..path.len() - rest.len()];
        let Some(name) = rest.first().filter(|_| depth < 16) else { return Some(source) };
        if source.defined.contains(name) {
            return Some(source);
        }
        let here = |i: &&Import| i.module == module;
        if let Some(import) = source.imports.iter().filter(here).find(|i| i.name.as_ref() == Some(name))
            && let Some(mut target) = self.absolute(source, module, &import.path)
            && target != path[..=module.len()]
        {
            target.extend(rest[1..].iter().cloned());
            return self.definer(&target, depth + 1);
        }
        for glob in source.imports.iter().filter(here).filter(|i| i.name.is_none()) {
            let Some(mut target) = self.absolute(source, module, &glob.path) else { continue };
            if target == module {
                continue;
            }
            target.push(name.clone());
            if let Some(found) = self.definer(&target, depth + 1)
                && found.defined.contains(name)
            {
                return Some(found);
            }
        }
        Some(source)
    }

    /// The files that each file depends on.
    pub(crate) fn dependencies(&self) -> BTreeMap<String, BTreeMap<String, Cause>> {
        let mut all = BTreeMap::new();
        for source in self.modules.values() {
            let mut targets: BTreeMap<String, Cause> = BTreeMap::new();
            let mut add = |line: usize, written: &[String], target: Option<&Source>| {
                if let Some(target) = target.filter(|t| t.file != source.file) {
                    let cause = Cause { line, path: written.join("::") };
                    targets.entry(target.file.clone()).or_insert(cause);
                }
            };
            for import in &source.imports {
                let Some(path) = self.absolute(source, &import.module, &import.path) else { continue };
                let target = self.definer(&path, 0);
                let module = self.modules.contains_key(&path);
                let used = match &import.name {
                    // What a module's name stands for is seen where it is used.
                    Some(_) if module => false,
                    Some(name) => !import.public || source.mentioned.contains(name),
                    None => {
                        let names = target.map(|t| &t.defined);
                        !import.public || names.is_some_and(|n| !n.is_disjoint(&source.mentioned))
                    }
                };
                if used {
                    add(import.line, &import.path, target);
                }
            }
            for (line, module, written) in &source.paths {
                let Some(path) = self.absolute(source, module, written) else { continue };
                if !self.modules.contains_key(&path) {
                    add(*line, written, self.definer(&path, 0));
                }
            }
            all.insert(source.file.clone(), targets);
        }
        all
    }
}

/// Files that depend on each other in a circle, sorted, and a text that names the causes.
pub(crate) fn circles(dependencies: &BTreeMap<String, BTreeMap<String, Cause>>) -> Vec<(Vec<String>, String)> {
    let reached = |from: &String| {
        let mut seen = BTreeSet::new();
        let mut open = vec![from];
        while let Some(file) = open.pop() {
            for next in dependencies.get(file).into_iter().flat_map(BTreeMap::keys) {
                if seen.insert(next) {
                    open.push(next);
                }
            }
        }
        seen
    };
    let reach: BTreeMap<&String, BTreeSet<&String>> = dependencies.keys().map(|f| (f, reached(f))).collect();
    let mut found: BTreeMap<Vec<String>, String> = BTreeMap::new();
    for (file, seen) in reach.iter().filter(|(f, seen)| seen.contains(*f)) {
        let circle: Vec<String> = seen.iter().filter(|f| reach[**f].contains(file)).map(|f| (*f).clone()).collect();
        let mut text = String::new();
        for from in &circle {
            for (to, cause) in dependencies[from].iter().filter(|(to, _)| circle.contains(to)) {
                text += &format!("\n  {from}:{}: `{}` is in {to}", cause.line, cause.path);
            }
        }
        found.insert(circle, text);
    }
    found.into_iter().collect()
}
