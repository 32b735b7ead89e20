// The source of a page that was sent: its own numbers, read only.
(() => {
  const held = JSON.parse(Numbers.inflated(document.getElementById("switch-numbers").textContent));
  let open = null;
  const kernel = () => (open ??= Kernel.open(held.kernel));
  const quote = (word) => (/^[\w.\/-]+$/.test(word) ? word : `'${word}'`);
  const { S } = Studio;
  S.source = {
    model: async (on) => Kernel.model(kernel(), on),
    plain: async (on) => Kernel.model(kernel(), on),
    later: "in `aloft studio`",
    without_parameters: held.kernel.base.length ? "" : "The parameters of this body are in `aloft studio`.",
    // the command that makes the choice the model
    next: (on) => {
      const added = on.filter((k) => !S.state.model.includes(k)), gone = S.state.model.filter((k) => !on.includes(k));
      const [what, key] = added.length ? ["add", added[0]] : ["remove", gone[0]];
      return `to make it the model: \`${held.commands[what]} ${quote(key)}\`` + (added.length + gone.length > 1 ? " and so on" : "");
    },
  };
  const fewer = Studio.at("fewer");
  fewer.hidden = !held.kernel.left_out.length;
  fewer.replaceChildren(...Studio.prose(`${held.kernel.left_out.length} more in \`aloft studio\`, with settings, recordings and exact numbers.`));
  Studio.begin(held.state).catch(Studio.problem);
})();
