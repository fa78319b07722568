// A PLC by node-opcua: a float, an array, a counter that is bad for a while, and a boolean that never changes.
const { OPCUAServer } = require("node-opcua-server");
const { OPCUACertificateManager } = require("node-opcua-certificate-manager");
const { Variant, DataType, VariantArrayType } = require("node-opcua-variant");
const { StatusCodes } = require("node-opcua-status-code");

(async () => {
  const [port, folder] = process.argv.slice(2);
  const trust = new OPCUACertificateManager({ automaticallyAcceptUnknownCertificate: true, rootFolder: folder });
  await trust.initialize();
  const server = new OPCUAServer({ port: Number(port), hostname: "127.0.0.1", resourcePath: "/UA/Other", serverCertificateManager: trust });
  await server.initialize();
  const space = server.engine.addressSpace;
  const own = space.registerNamespace("urn:other:plc");
  const cell = own.addObject({ organizedBy: space.rootFolder.objects, browseName: "Cell" });
  const add = (name, dataType, more) => own.addVariable({ componentOf: cell, nodeId: `s=${name}`, browseName: name, dataType, ...more });
  const power = add("Power", "Float"), still = add("Still", "Boolean"), number = add("Number", "Int32");
  const position = add("Position", "Double", { valueRank: 1, arrayDimensions: [2] });
  still.setValueFromSource(new Variant({ dataType: DataType.Boolean, value: true }));
  let n = 0;
  setInterval(() => {
    n++;
    power.setValueFromSource(new Variant({ dataType: DataType.Float, value: 1.5 }));
    const value = new Float64Array([90, -n]);
    position.setValueFromSource(new Variant({ dataType: DataType.Double, arrayType: VariantArrayType.Array, value }));
    const status = n % 20 < 5 ? StatusCodes.BadSensorFailure : StatusCodes.Good;
    number.setValueFromSource(new Variant({ dataType: DataType.Int32, value: n }), status);
  }, 50);
  await server.start();
  console.log("ready");
})();
