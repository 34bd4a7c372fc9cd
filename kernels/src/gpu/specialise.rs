//! Specialisation: reduces a shader module to the code that one pipeline runs.
//!
//! The override constants of a pipeline decide most branches of a large module, but drivers may remove dead branches only after they have
//! inlined and transformed their code. Mesa, for example, takes about 2 s for a shading pipeline even if its variant is simple.
//! Specialisation therefore replaces the constants by their values before the module reaches the driver. If the condition of an `if` is then
//! constant, the `if` is replaced by the branch that is taken. What is no longer referenced is removed.

use naga::back::PipelineConstants;
use naga::back::pipeline_constants::process_overrides;
use naga::compact::{KeepUnused, compact};
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{Arena, Block, Constant, Expression, Function, Handle, Literal, Module, Statement};

/// A shader module from which the modules of single pipelines are derived.
pub(crate) struct Template {
    module: Module,
    info: ModuleInfo,
}

impl Template {
    /// Parses a module that the device has already accepted.
    ///
    /// # Errors
    /// When naga rejects the module; the error is naga's message.
    pub(crate) fn new(source: &str) -> Result<Template, String> {
        let module = naga::front::wgsl::parse_str(source).map_err(|error| error.message().to_owned())?;
        let info =
            Validator::new(ValidationFlags::all(), Capabilities::all()).validate(&module).map_err(|error| error.as_inner().to_string())?;
        Ok(Template { module, info })
    }

    /// Returns the module with the values of `overrides` filled in, reduced to `entry_points` and everything that they use.
    ///
    /// # Errors
    /// When naga cannot fill in the values, for example because a given name is not an override of the module, or a value does not fit the type of
    /// the override.
    pub(crate) fn cut(&self, entry_points: &[&str], overrides: &[(&str, f64)]) -> Result<Module, String> {
        let constants: PipelineConstants = overrides.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
        let (resolved, _) = process_overrides(&self.module, &self.info, None, &constants).map_err(|error| error.to_string())?;
        let mut module = resolved.into_owned();
        module.entry_points.retain(|entry| entry_points.contains(&entry.name.as_str()));
        let globals = Globals { constants: module.constants.clone(), expressions: module.global_expressions.clone() };
        for (_, function) in module.functions.iter_mut() {
            globals.prune(function);
        }
        for entry in &mut module.entry_points {
            globals.prune(&mut entry.function);
        }
        compact(&mut module, KeepUnused::No);
        Ok(module)
    }
}

/// The module-level items that functions refer to.
struct Globals {
    constants: Arena<Constant>,
    expressions: Arena<Expression>,
}

impl Globals {
    /// Replaces each `if` whose condition is constant by the branch that is taken. Drops statements that follow a jump in their block, because they
    /// never run.
    fn prune(&self, function: &mut Function) {
        let mut body = std::mem::take(&mut function.body);
        self.prune_block(&mut body, &function.expressions);
        let mut computed = Vec::new();
        gather(&body, &mut computed);
        computed.sort_unstable();
        // `compact` keeps every expression that has a name. So the names of expressions that no remaining statement computes are removed. Expressions
        // that need no statement, such as constants and arguments, keep their names.
        let is_computed = |handle: Handle<Expression>| computed.binary_search(&handle).is_ok();
        let expressions = &function.expressions;
        function.named_expressions.retain(|&handle, _| expressions[handle].needs_pre_emit() || is_computed(handle));
        function.body = body;
    }

    /// The value of a condition, if the condition is a literal or a constant; otherwise `None`.
    fn decided(&self, condition: Handle<Expression>, local: &Arena<Expression>) -> Option<bool> {
        let literal = match local[condition] {
            Expression::Constant(constant) => &self.expressions[self.constants[constant].init],
            ref other => other,
        };
        if let Expression::Literal(Literal::Bool(value)) = *literal { Some(value) } else { None }
    }

    fn prune_block(&self, block: &mut Block, local: &Arena<Expression>) {
        let mut kept = Block::with_capacity(block.len());
        for (statement, span) in std::mem::take(block).span_into_iter() {
            match statement {
                Statement::If { condition, mut accept, mut reject } => match self.decided(condition, local) {
                    Some(taken) => {
                        let mut side = if taken { accept } else { reject };
                        self.prune_block(&mut side, local);
                        kept.extend_block(side);
                    }
                    None => {
                        self.prune_block(&mut accept, local);
                        self.prune_block(&mut reject, local);
                        kept.push(Statement::If { condition, accept, reject }, span);
                    }
                },
                Statement::Block(mut inner) => {
                    self.prune_block(&mut inner, local);
                    kept.push(Statement::Block(inner), span);
                }
                Statement::Loop { mut body, mut continuing, break_if } => {
                    self.prune_block(&mut body, local);
                    self.prune_block(&mut continuing, local);
                    kept.push(Statement::Loop { body, continuing, break_if }, span);
                }
                Statement::Switch { selector, mut cases } => {
                    for case in &mut cases {
                        self.prune_block(&mut case.body, local);
                    }
                    kept.push(Statement::Switch { selector, cases }, span);
                }
                other => kept.push(other, span),
            }
            // If this statement leaves the block, the statements after it never run, so they are dropped.
            if kept.last().is_some_and(ends) {
                break;
            }
        }
        *block = kept;
    }
}

/// Whether this statement is a return, kill, break or continue, or a block that ends with one. Statements that follow it in its block never run.
fn ends(statement: &Statement) -> bool {
    match statement {
        Statement::Return { .. } | Statement::Kill | Statement::Break | Statement::Continue => true,
        Statement::Block(inner) => inner.last().is_some_and(ends),
        _ => false,
    }
}

/// Appends to `computed` the expressions that the statements of a block evaluate, and the results of its calls.
fn gather(block: &Block, computed: &mut Vec<Handle<Expression>>) {
    for statement in block.iter() {
        match statement {
            Statement::Emit(range) => computed.extend(range.clone()),
            Statement::Call { result: Some(result), .. } => computed.push(*result),
            Statement::Block(inner) => gather(inner, computed),
            Statement::If { accept, reject, .. } => {
                gather(accept, computed);
                gather(reject, computed);
            }
            Statement::Loop { body, continuing, .. } => {
                gather(body, computed);
                gather(continuing, computed);
            }
            Statement::Switch { cases, .. } => cases.iter().for_each(|case| gather(&case.body, computed)),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOURCE: &str = "
        override KIND: u32 = 0u;
        override IS_DEAR: bool = (KIND == 0u) | ((KIND & 2u) != 0u);
        @group(0) @binding(0) var<storage, read> table: array<f32>;
        @group(0) @binding(1) var<storage, read_write> out: array<f32>;
        fn dear(i: u32) -> f32 { let square = table[i] * table[i]; return square; }
        fn either(i: u32) -> f32 {
            if IS_DEAR { let value = dear(i); return value + 1.0; }
            let plain = f32(i);
            return plain;
        }
        @compute @workgroup_size(1) fn first(@builtin(global_invocation_id) id: vec3<u32>) {
            for (var i = 0u; i < id.x; i++) { if !IS_DEAR { continue; } out[i] = either(i); }
            out[id.x] = either(id.x);
        }
        @compute @workgroup_size(1) fn second() { out[0] = table[0]; }
    ";

    fn functions(module: &Module) -> Vec<&str> {
        module.functions.iter().filter_map(|(_, f)| f.name.as_deref()).collect()
    }

    #[test]
    fn what_the_constants_rule_out_is_gone_and_the_rest_is_valid() {
        let template = Template::new(SOURCE).expect("it parses");
        let validate = |module: &Module| {
            Validator::new(ValidationFlags::all(), Capabilities::all()).validate(module).map(|_| ()).map_err(|e| e.to_string())
        };
        for (kind, dear) in [(0.0, true), (1.0, false), (2.0, true)] {
            let module = template.cut(&["first"], &[("KIND", kind)]).expect("it is cut");
            validate(&module).unwrap_or_else(|error| panic!("KIND {kind}: {error}"));
            assert_eq!(functions(&module).contains(&"dear"), dear, "KIND {kind}");
            assert_eq!(module.global_variables.len(), if dear { 2 } else { 1 }, "KIND {kind}");
            assert_eq!(module.entry_points.len(), 1);
        }
        let both = template.cut(&["first", "second"], &[("KIND", 1.0)]).expect("it is cut");
        validate(&both).expect("valid");
        assert_eq!((both.entry_points.len(), both.global_variables.len()), (2, 2));
        assert!(template.cut(&["first"], &[("KIN", 1.0)]).is_err(), "`KIN` is not an override of the module");
        assert!(Template::new("fn f( {").is_err());
    }
}
